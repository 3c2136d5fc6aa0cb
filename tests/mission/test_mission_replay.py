"""What peers replay: from every checkpoint the same, whatever is done to the evidence a refusal, and no secret in it."""

from __future__ import annotations

import hashlib
import math
import random
import zlib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from audited import PLAN, SENSORS, Recording, errand
from phalanx.errors import PeerError
from phalanx.mission import Profile
from phalanx.mission.file.sealed import open_payload, open_secret, try_observation
from phalanx.mission.walk.claims import Unshown
from phalanx.mission.walk.gate import Hint
from phalanx.robot.controllers.mission.evidence import BadEvidence, pack_evidence, unpack_evidence
from worlds import BOTH, built, cheap, corridor, walk, walker_of

both = pytest.mark.parametrize("profile", BOTH)
BEAMS = SENSORS.lidar.beams


def replayed(recording: Recording, k: int):
    """A robot without keys, from the checkpoint before step k to the end: (outputs, state) of each step."""
    controller = recording.replays(1)
    controller.decode(recording.steps[k - 1].state if k else recording.boot)
    for each in recording.steps[k:]:
        outputs = controller.on_evidence(each.step, each.t_ms, each.reading, each.evidence)
        yield outputs, controller.encode()


@both
def test_replay_from_every_checkpoint_is_the_same_to_the_bit(profile):
    recording = Recording.of(profile)
    assert len(recording.steps) > 60
    assert len([each for each in recording.steps if each.evidence]) >= 5
    for k in range(0, len(recording.steps), 7):
        for each, (outputs, state) in zip(recording.steps[k:], replayed(recording, k), strict=True):
            assert outputs == each.outputs
            assert state == each.state
    # And one step from each of them.
    for k in range(len(recording.steps)):
        outputs, state = next(replayed(recording, k))
        assert (outputs, state) == (recording.steps[k].outputs, recording.steps[k].state)


@both
def test_left_out_evidence_is_nothing_seen(profile):
    """A robot can pretend not to have seen: then it has not got on, and replay says so."""
    recording = Recording.of(profile)
    controller = recording.replays(1)
    for each in recording.steps:
        controller.on_evidence(each.step, each.t_ms, each.reading, b"")
    assert controller.memory.walk.opened == {}


@both
def test_claims_are_taken_only_in_the_order_of_the_graph_and_with_their_own_reading(profile):
    recording = Recording.of(profile)
    claims = [each for each in recording.steps if each.evidence[:1] > b"\0"]
    assert len(claims) == 3
    for k, each in enumerate(recording.steps):
        if each not in claims:
            continue
        for other in claims:
            controller = recording.replays(1)
            controller.decode(recording.steps[k - 1].state if k else recording.boot)
            if other is each:
                controller.on_evidence(each.step, each.t_ms, each.reading, each.evidence)
                continue
            shown, scan = unpack_evidence(other.evidence, BEAMS)
            for evidence in {other.evidence, pack_evidence(shown, b""), pack_evidence(shown, each.raw)}:
                with pytest.raises((Unshown, BadEvidence)):
                    controller.on_evidence(each.step, each.t_ms, each.reading, evidence)
            assert scan or shown.node == 0


def mutations(raw: bytes, dice: random.Random):
    data = bytearray(raw)
    match dice.randrange(5):
        case 0:
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        case 1:
            del data[dice.randrange(len(data)) :]
        case 2:
            data += dice.randbytes(dice.randrange(1, 40))
        case 3:
            at = dice.randrange(len(data))
            data[at : at + dice.randrange(1, 30)] = dice.randbytes(dice.randrange(30))
        case 4:
            data = bytearray(dice.randbytes(dice.randrange(1, 3000)))
    return bytes(data)


@both
def test_evidence_mutated_a_thousand_times_is_refused_by_type_and_never_believed(profile):
    recording, dice = Recording.of(profile), random.Random(5)
    shown = [k for k, each in enumerate(recording.steps) if each.evidence]
    refused = 0
    for _ in range(1000):
        k = dice.choice(shown)
        each = recording.steps[k]
        evidence = mutations(each.evidence, dice)
        controller = recording.replays(1)
        controller.decode(recording.steps[k - 1].state if k else recording.boot)
        try:
            outputs = controller.on_evidence(each.step, each.t_ms, each.reading, evidence)
        except PeerError:
            refused += 1
            continue
        if not evidence:
            continue
        # What passes says the same thing in other bytes, or claims less.
        honest = recording.replays(1)
        honest.decode(each.state)
        assert controller.memory.walk.opened.keys() <= honest.memory.walk.opened.keys()
        assert outputs
    assert refused > 900


def test_neither_log_nor_checkpoint_nor_evidence_holds_a_gate_a_secret_or_a_name():
    recording, one = Recording.of(Profile.SEALED), errand(Profile.SEALED)
    held = b"".join(
        each.reading + each.evidence + each.state + b"".join(output.payload for output in each.outputs)
        for each in recording.steps
    )
    unpacked = b"".join(part for each in recording.steps if each.evidence for part in _parts(each.evidence))
    header, keys = one.mission.header, recording.controllers[-1].memory.walk.keys
    secrets = [gate.share for gate in (*keys.gates.values(), *one.key.gates.values())]
    secrets += list(keys.proofs.values())
    assert len(secrets) == 2 + 1 + 3
    for each in recording.steps:
        claim = unpack_evidence(each.evidence, BEAMS)[0] if each.evidence else None
        if claim:
            _, key = try_observation(header, claim.observed, Hint(claim.shape, claim.offset), claim.salt)
            record = one.mission.nodes[claim.node]
            secret = open_secret(header, claim.node, claim.alias, key, record.aliases[claim.alias].secret)
            payload = open_payload(header, claim.node, record, secret)
            secrets += [key, secret, payload.name.encode()]
    assert len(secrets) == 6 + 9
    for secret in secrets:
        assert len(secret) > 4
        assert secret not in held + unpacked


def _parts(evidence: bytes):
    claim, scan = unpack_evidence(evidence, BEAMS)
    yield claim.encode() if claim else b""
    yield scan


def test_a_scan_packs_to_half_of_it_and_unpacks_to_the_same_and_to_no_more():
    recording = Recording.of(Profile.PAPER)
    for each in recording.steps[::10]:
        packed = pack_evidence(None, each.raw)
        assert len(packed) < 0.65 * len(each.raw)
        assert unpack_evidence(packed, BEAMS) == (None, each.raw)
        with pytest.raises(BadEvidence):
            unpack_evidence(packed, BEAMS - 1)
    bomb = b"\0" + zlib.compress(bytes(50_000_000))
    with pytest.raises(BadEvidence):
        unpack_evidence(bomb, BEAMS)
    with pytest.raises(BadEvidence, match="2 claims instead of 0 or 1"):
        unpack_evidence(b"\2" + packed[1:], BEAMS)


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=300))
def test_any_bytes_are_evidence_or_refused_and_so_are_readings(raw):
    for parse in (lambda: unpack_evidence(raw, BEAMS), lambda: SENSORS.parse(raw)):
        try:
            parse()
        except PeerError:
            continue
    controller = Recording.of(Profile.PAPER).replays(1)
    (stop,) = controller.on_evidence(0, 1000, raw, b"") if len(raw) != SENSORS.reading_bytes else (None,)
    assert stop is None or stop.payload[-4:] == bytes(4), "a reading that makes no sense stops the wheels"


def test_a_reading_says_where_wheels_turned_to_and_how_much_room_there_is():
    recording = Recording.of(Profile.PAPER)
    each = recording.steps[40]
    reading = SENSORS.parse(each.reading)
    assert reading.scan_sha1 == hashlib.sha1(each.raw).digest()
    scan = SENSORS.scan_of(each.raw)
    for k, clear in enumerate(reading.clear):
        sector = scan.ranges_m[12 * k : 12 * k + 12]
        nearest = min(value for value in [*sector, 99.0] if value == value)
        assert clear == min(255, int(nearest * 1000 + 0.5) // 20)


@both
def test_a_wrong_odometry_gets_no_robot_further(profile):
    """The same evidence with a reading whose odometry says two metres more: not where the landmark is."""
    recording = Recording.of(profile)
    k, each = next((k, s) for k, s in enumerate(recording.steps) if k and s.evidence[:1] > b"\0")
    controller = recording.replays(1)
    controller.decode(recording.steps[k - 1].state)
    # Two metres before the last odometry, the next says so much more way.
    belief, (x_m, y_m, heading) = controller.memory.belief, controller.memory.odometry
    away = x_m - 2.0 * math.cos(heading), y_m - 2.0 * math.sin(heading), heading
    controller.memory = replace(controller.memory, odometry=away)
    with pytest.raises(Unshown):
        controller.on_evidence(each.step, each.t_ms, each.reading, each.evidence)
    assert PLAN.inside(*belief.pose[:2])


def test_who_replays_a_whole_walk_holds_no_gate_of_it():
    """One KDF opens a node's payload; the gates in it want the gate that the robot came through."""
    recording = Recording.of(Profile.SEALED)
    controller = recording.replays(1)
    for each in recording.steps:
        controller.on_evidence(each.step, each.t_ms, each.reading, each.evidence)
    assert len(controller.memory.walk.opened) == 3
    assert controller.memory.walk.keys.gates == {}
    assert len(recording.controllers[-1].memory.walk.keys.gates) == 2


@both
def test_a_walk_in_two_halves_is_the_walk_in_one(profile):
    """`look` and `advance` come to what `step` comes to, where nothing but a claim shows what is seen."""
    mission = cheap(corridor(5), profile)
    walker = walker_of(built(mission, profile))
    decoded = [o.decoded.node for _, o in walk(mission, walker) if o.decoded]

    class Halves:
        def step(self, state, seen):
            state, claim, _ = walker.look(state, seen)
            return walker.advance(state, seen, claim)

    assert [o.decoded.node for _, o in walk(mission, Halves()) if o.decoded] == decoded == [0, 1, 2, 3, 4]
