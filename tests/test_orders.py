"""Orders that a robot can check: by whom, for whom, new, in time; and what a liar can do with them."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import given, settings
from hypothesis import strategies as st

from ordered import MISSION, PUBLIC, order, reading, robot, route_order, signer, stop_order, wheels, wheels_order
from phalanx.bti import trusted
from phalanx.robot.controllers.orders import DRIFT, LATE_MS
from phalanx.robot.station import AT_ONCE, COLOUR, MOTION, Station
from phalanx.wire.driven import (
    EVERYBODY,
    GATEWAY,
    OPERATOR,
    ORDER,
    SIGNATURE_BYTES,
    TELL_GO,
    TELL_NOTHING,
    TELL_ROUTE,
    TELL_WHEELS,
    WHEELS_MEMORY,
)
from phalanx.wire.fields import row

TOLD = json.loads((Path(__file__).parent.parent / "vectors" / "orders.json").read_text())
SOON = settings(deadline=None, max_examples=50)
CHECKS = WHEELS_MEMORY.at("checks")


def heard(packet: bytes, this=None) -> bytes:
    """What a robot remembers then, but for how often it has looked at signatures."""
    this = this or robot()
    this.on_recv(0, packet)
    return remembered(this)


def remembered(this) -> bytes:
    state = this.encode()
    return state[:CHECKS] + state[CHECKS + 1 :]


def checked(this) -> int:
    return this.encode()[CHECKS]


@pytest.mark.parametrize("case", TOLD["cases"], ids=[case["name"] for case in TOLD["cases"]])
def test_a_robot_obeys_what_the_vectors_say(case):
    keys = {f"{name}_key": bytes.fromhex(TOLD[name]) for name in ("gateway", "operator")}
    this = robot(TOLD["robot"], mission=TOLD["mission"], **keys)
    before = remembered(this)
    assert (heard(bytes.fromhex(case["frame"]), this) != before) == (case["expect"] == "obeyed")


class TestSignature:
    @SOON
    @given(st.binary(max_size=300), st.binary(min_size=32, max_size=32), st.data())
    def test_it_is_the_peers_and_any_flipped_bit_is_refused(self, message, secret, data):
        key = Ed25519PrivateKey.from_private_bytes(secret)
        public = key.public_key().public_bytes_raw()
        whole = bytearray(message + key.sign(message))
        # Twice: what was found is remembered.
        assert [trusted.order_check(row(public), row(bytes(whole)), len(whole)) for _ in range(2)] == [0, 0]
        bit = data.draw(st.integers(0, 8 * len(whole) - 1))
        whole[bit // 8] ^= 1 << bit % 8
        with pytest.raises(InvalidSignature):
            Ed25519PublicKey.from_public_bytes(public).verify(bytes(whole[-64:]), bytes(whole[:-64]))
        assert [trusted.order_check(row(public), row(bytes(whole)), len(whole)) for _ in range(2)] == [-1, -1]

    def test_a_key_of_zeros_is_nobodys_and_sizes_are_looked_at(self):
        nobody, packet = row(bytes(32)), row(bytes(100))
        # Of small order: a third of all forgeries would be believed.
        assert {trusted.order_check(nobody, row(bytes([n]) + bytes(99)), 100) for n in range(32)} == {-1}
        assert trusted.order_check(row(bytes(31)), packet, 100) == trusted.E_ARG
        assert trusted.order_check(nobody, packet, 101) == trusted.E_ARG
        assert trusted.order_check(row(PUBLIC[GATEWAY]), packet, SIGNATURE_BYTES - 1) == -1

    @SOON
    @given(st.data())
    def test_a_robot_ignores_an_order_of_which_a_bit_is_flipped(self, data):
        packet = bytearray(data.draw(st.sampled_from([wheels_order(1, 1, 5, 6), route_order(1, 1, 9, [(1, 2)])])))
        assert heard(bytes(packet)) != remembered(robot())
        bit = data.draw(st.integers(0, 8 * len(packet) - 1))
        packet[bit // 8] ^= 1 << bit % 8
        assert heard(bytes(packet)) == remembered(robot())

    def test_nobody_obeys_whom_the_mission_does_not_name(self):
        this = robot(gateway_key=b"", operator_key=b"")
        before = remembered(this)
        for who in (GATEWAY, OPERATOR):
            assert heard(wheels_order(1, 1, 5, 5, who=who), this) == before


class TestNews:
    @SOON
    @given(st.lists(st.tuples(st.sampled_from([GATEWAY, OPERATOR]), st.integers(1, 9)), min_size=1, max_size=12))
    def test_what_was_obeyed_once_is_never_obeyed_again(self, told):
        this = robot()
        packets = [wheels_order(1, number, number, who, who=who, said=number) for who, number in told]
        for packet in packets:
            this.on_recv(10, packet)
            this.on_input(0, 10, b"")
        after = remembered(this)
        for packet in packets:
            this.on_recv(11, packet)
            assert checked(this) == 0, "nor looked at"
        assert remembered(this) == after

    @SOON
    @given(st.integers(1, 2**32 - 1).filter(lambda mission: mission != MISSION), st.integers(1, 2**63 - 1))
    def test_another_missions_orders_cost_no_look_at_their_signature(self, mission, number):
        this = robot()
        this.on_recv(0, wheels_order(1, number, 5, 5, mission=mission, said=1))
        assert this.encode() == robot().encode()

    def test_each_signer_has_numbers_of_its_own(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 2**63 - 1, 5, 5, who=OPERATOR, said=0))
        this.on_recv(0, wheels_order(1, 1, 7, 7, said=0))
        assert wheels(this, 0) == (7, 7)

    @pytest.mark.parametrize("who", [GATEWAY, OPERATOR])
    def test_what_was_held_back_for_a_second_is_late_by_the_signers_beacon(self, who):
        for late_ms, obeyed in ((LATE_MS, (9, 9)), (LATE_MS + 1, (0, 0))):
            this = robot()
            this.on_recv(50_000, order(0, 1, TELL_NOTHING, said=7000, who=who))
            this.on_recv(50_500 + late_ms, wheels_order(1, 2, 9, 9, said=7500, who=who))
            assert wheels(this, 50_500 + late_ms) == obeyed

    def test_who_comes_sooner_teaches_what_is_late(self):
        this = robot()
        this.on_recv(50_900, order(0, 1, TELL_NOTHING, said=7000))
        this.on_recv(51_000, order(0, 2, TELL_NOTHING, said=8000))
        for late_ms, obeyed in ((LATE_MS + 2, (0, 0)), (LATE_MS, (9, 9))):  # the drift of 2 s is one of these
            this.on_recv(52_000 + late_ms, wheels_order(1, 3, 9, 9, said=9000))
            assert wheels(this, 52_000 + late_ms) == obeyed

    @pytest.mark.parametrize("ppm", [-200, 200, 400])
    def test_clocks_that_drift_apart_for_a_day_make_nobody_late(self, ppm):
        this = robot()
        for minute in range(24 * 60):
            t_ms = 60_000 * minute * (1_000_000 + ppm) // 1_000_000 + 5000
            this.on_recv(t_ms, order(0, minute + 1, TELL_NOTHING, said=60_000 * minute))
            this.on_input(minute, t_ms, b"")
        this.on_recv(t_ms, wheels_order(1, minute + 2, 9, 9, said=60_000 * minute))
        assert wheels(this, t_ms) == (9, 9)

    def test_who_holds_back_ever_more_gains_no_more_than_the_drift(self):
        this = robot()
        this.on_recv(0, order(0, 1, TELL_NOTHING, said=0))
        t_ms = 100_000
        most_ms = LATE_MS + t_ms // DRIFT
        for late_ms, obeyed in ((most_ms + 1, (0, 0)), (most_ms, (9, 9))):
            this.on_recv(t_ms, wheels_order(1, 2, 9, 9, said=t_ms - late_ms))
            assert wheels(this, t_ms) == obeyed


class TestStop:
    def test_it_needs_no_number_and_holds_until_the_same_signer_lets_go(self):
        this = robot()
        this.on_recv(0, route_order(1, 2**63 - 1, 60, [(500, 900)], said=10))
        this.on_recv(1, stop_order(0, 11))
        this.on_recv(1, stop_order(1, 11, who=OPERATOR))
        assert wheels(this, 1) == (0, 0)
        assert len(this.encode()) == WHEELS_MEMORY.size, "the route is gone"
        # The gateway has no number left, the operator may speak.
        this.on_recv(2, wheels_order(1, 1, 9, 9, who=OPERATOR, said=12))
        this.on_recv(2, route_order(1, 2, 60, [(500, 900)], who=OPERATOR, said=13))
        assert len(this.encode()) == WHEELS_MEMORY.size, "nor is another taken"
        this.on_recv(2, order(0, 3, TELL_GO, who=OPERATOR, said=14))
        this.on_recv(2, wheels_order(1, 4, 9, 9, who=OPERATOR, said=15))
        assert wheels(this, 2) == (0, 0), "the gateway holds it too"

    def test_after_go_motion_is_obeyed_and_the_old_stop_is_not(self):
        this, gateway = robot(), signer()
        old = gateway.stop(5)
        for packet in (old, gateway.go(6), gateway.wheels(1, 7, 9, 9), old):
            this.on_recv(0, packet)
        assert wheels(this, 0) == (9, 9)

    def test_neither_a_stop_nor_what_was_said_before_it_makes_old_words_new(self):
        this, gateway = robot(), signer()
        drove, on_its_way, stop = gateway.wheels(1, 1, 9, 9), gateway.beacon(2), gateway.stop(3)
        this.on_recv(0, drove)
        before = heard(stop, this)
        assert heard(drove, this) == before
        before = heard(on_its_way, this)
        for packet in (drove, on_its_way, stop):
            assert heard(packet, this) == before
        this.on_recv(0, gateway.go(4))
        for packet in (stop, drove):
            this.on_recv(0, packet)
        this.on_recv(0, gateway.wheels(1, 5, 7, 7))
        assert wheels(this, 0) == (7, 7)

    def test_a_go_that_is_older_than_the_stop_does_not_undo_it(self):
        this, gateway = robot(), signer()
        held_back, stop, go = gateway.go(1), gateway.stop(2), gateway.go(3)
        before = heard(stop, this)
        assert heard(held_back, this) == before
        assert heard(go, this) != before

    def test_a_stop_comes_through_though_numbers_were_used_up(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 2**63 - 1, 9, 9, said=5))
        this.on_recv(0, stop_order(0, 6))
        assert wheels(this, 0) == (0, 0)

    def test_a_stop_that_was_held_back_is_late_too(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 1, 9, 9, said=5))
        this.on_recv(LATE_MS, stop_order(0, 4))
        this.on_recv(LATE_MS + 10, stop_order(0, 6))
        assert wheels(this, 0) == (9, 9)


class TestLiar:
    @pytest.mark.parametrize("looks", [1, 3, 16])
    def test_forgeries_have_so_many_looks_from_one_reading_to_the_next(self, looks):
        this = robot(looks=looks)
        forged = [wheels_order(1, n, 1, 1, key=OPERATOR) for n in range(1, 3 * looks)]
        for packet in forged[: looks - 1]:
            this.on_recv(0, packet)
        this.on_recv(0, wheels_order(1, 1, 9, 9))
        assert wheels(this, 0) == (9, 9), "one look was left"
        for packet in [*forged, *forged]:
            this.on_recv(0, packet)
        assert checked(this) == looks
        this.on_recv(0, wheels_order(1, 2, 8, 8))
        assert wheels(this, 0) == (9, 9), "the price: until the next reading true ones are not looked at either"
        this.on_recv(0, wheels_order(1, 2, 8, 8))
        assert (wheels(this, 0), checked(this)) == ((8, 8), 0)

    def test_what_cannot_be_obeyed_is_not_looked_at(self):
        this = robot()
        this.on_recv(5000, wheels_order(1, 5, 9, 9, said=5000))
        this.on_input(0, 5000, reading(1, 0, 0, 0))
        for packet in (
            wheels_order(1, 5, 1, 1, key=OPERATOR, said=5000),
            wheels_order(2, 6, 1, 1, key=OPERATOR, said=5000),
            wheels_order(1, 6, 1, 1, key=OPERATOR, said=5000 - LATE_MS - 1),
            wheels_order(1, 6, 1, 1, key=OPERATOR, said=5000)[:-1],
            stop_order(0, 5000, key=OPERATOR),
        ):
            this.on_recv(5000, packet)
        assert checked(this) == 0


def test_a_signers_clock_that_stands_or_goes_back_makes_no_order_old():
    this, gateway = robot(), signer()
    for packet in (gateway.wheels(1, 50, 1, 1), gateway.stop(50), gateway.go(40), gateway.wheels(1, 40, 9, 9)):
        this.on_recv(0, packet)
    assert wheels(this, 0) == (9, 9)
    assert gateway.number == 3


class Heard:
    """An air on which all that is said is noted: to whom, and which action."""

    def __init__(self):
        self.said = []

    def is_busy(self) -> bool:
        return False

    def is_permanently_stopped(self, _robot: int) -> bool:
        return False

    def say(self, packet: bytes, robot: int) -> None:
        self.said.append((robot, ORDER.decode(packet)["action"]))


def said_from(station: Station, now_s: float, end_s: float) -> list[tuple[int, int]]:
    """All but beacons."""
    air = Heard()
    while now_s < end_s:
        station.send_due(air, now_s, round(1000 * now_s))
        now_s += 0.005
    return [each for each in air.said if each[1] != TELL_NOTHING]


def test_a_stop_waits_neither_for_colours_nor_for_a_long_route_when_a_station_is_hushed():
    station = Station(signer(GATEWAY), signer(OPERATOR))
    gateway = station.gateway
    for rob in (1, 2):
        station.queue_order(rob, MOTION, partial(gateway.route, threshold_mm=50, points_mm=[(1, 1)] * 32))
    assert said_from(station, 0.0, 0.05) == [(1, TELL_ROUTE), (2, TELL_ROUTE)]
    for rob in (1, 2):
        station.queue_order(rob, COLOUR, partial(gateway.led, red=1, green=2, blue=3))
        station.queue_order(rob, MOTION, partial(gateway.wheels, left_pct=0, right_pct=0))
    assert said_from(station, 0.05, 0.1) == [], "the robots' logs have no room yet"
    station.drop_pending()
    assert said_from(station, 0.1, 0.15) == [(1, TELL_WHEELS), (2, TELL_WHEELS)]
    assert not station.has_pending_order


def test_robots_are_told_that_they_may_go_by_a_station_that_never_stopped_them():
    station = Station(signer(GATEWAY), signer(OPERATOR))
    assert said_from(station, 0.0, 1.0) == []
    station.release()
    assert said_from(station, 1.0, 1.45) == [(EVERYBODY, TELL_GO)] * AT_ONCE
