"""The radio against ns-3, a packet at a time: the disc, latencies; and against its rules. Shares: test_radio_ns3.py."""

from __future__ import annotations

import csv
import os
import subprocess
import sys

import numpy as np
import pytest

from commands import ROOT
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.world.audited.events import make_queue, next_us, pop, refused
from phalanx.world.radio import channel as radio
from phalanx.world.radio.channel import ATTEMPT, BROADCAST, attempt, enqueue, finish, make_air, silence
from phalanx.world.radio.reach import make_reach, rebuild
from radio_replay import replay

RADIO = ROOT / "tests" / "data" / "radio"
BYTES = {"b27": 27, "u1000": 1000, "u2000": 2000, "u3500": 3500}

ROOMY = RadioConfig(long_bytes=3500)


def rows(name):
    with (RADIO / name).open() as file:
        return list(csv.DictReader(file))


class World:
    """A few robots and an event loop in Python, one call at a time."""

    def __init__(self, pos, config=ROOMY, seed=0):
        self.pos = np.array(pos, np.float64)
        n = len(pos)
        self.air, self.queue, self.reach = make_air(n, config, seed), make_queue(4 * n), make_reach(n, config.range_m)
        rebuild(self.reach, self.pos)
        self.heard, self.left, self.receivers = [], [], np.zeros(n, np.int32)

    def send(self, robot, length, dst, now_us, first=1):
        packet = np.full(length, first, np.uint8)
        return enqueue(self.air, self.queue, robot, packet, length, dst, now_us)

    def run(self, until_us=1 << 60):
        while self.queue.tally[0] and next_us(self.queue) < until_us:
            now_us, kind, robot, arg = pop(self.queue)
            if kind == ATTEMPT:
                attempt(self.air, self.reach, self.queue, robot, now_us)
            else:
                end = finish(self.air, self.reach, self.queue, robot, arg, now_us, self.receivers)
                for k in self.receivers[: end.receivers].tolist():
                    self.heard.append((now_us, k, len(end.packet), int(end.packet[-1])))
                if end.left != radio.NOBODY:
                    self.left.append((now_us, end.left, end.arrived))
        assert refused(self.queue) == 0
        return self

    def who_heard(self):
        return sorted({k for _, k, _, _ in self.heard})


class TestDisc:
    def test_the_range_is_what_the_path_loss_says(self):
        assert RadioConfig().range_m == pytest.approx(116.323, abs=0.001)
        assert RadioConfig(exponent=2.0).range_m == pytest.approx(116.323**1.5, rel=1e-3)

    def test_every_frame_of_the_reference_arrives_here_if_it_arrived_there_and_after_as_long(self):
        reference = rows("pdr_vs_distance.csv")
        assert len(reference) == 664
        for row in reference:
            length, d = BYTES[row["class"]], float(row["distance_m"])
            dst = BROADCAST if row["class"] == "b27" else 1
            delays = []
            world = World([(0, 0), (d, 0)])
            for at_us in (0, 90_002, 180_004, 270_006, 360_008):  # all over a slot: the packet waits for the next
                world.send(0, length, dst, at_us)
                world.run()
                delays += [now_us - at_us for now_us, _, _, _ in world.heard]
                world.heard.clear()
            assert len(delays) == 5 * float(row["pdr"]), row
            if delays:
                assert np.mean(delays) == pytest.approx(1e6 * float(row["mean_latency_s"]), rel=0.02), row

    def test_a_unicast_to_somebody_out_of_range_costs_seven_frames(self):
        world = World([(0, 0), (120, 0)])
        world.send(0, 2000, 1, 0)
        world.run()
        assert world.left[0][1:] == (0, 0)
        assert world.air.counts[0, radio.APP_UNICAST, radio.AIRTIME_US] == 7 * 620
        assert world.air.tried[0, radio.APP_UNICAST] == 7 * world.air.counts[0, radio.APP_UNICAST, radio.BYTES]
        assert world.air.counts[0, radio.APP_UNICAST, radio.DUE] == 1
        assert radio.delivery(world.air, radio.APP_UNICAST) == 0.0
        assert np.isnan(radio.delivery(world.air, radio.AUDIT_UNICAST))

    def test_a_share_of_receptions_is_lost_by_chance_and_the_same_ones_with_the_same_seed(self):
        def heard(loss, seed):
            world = World([(0, 0), (50, 0), (0, 50)], RadioConfig(loss=loss), seed)
            for n in range(1000):
                world.send(0, 27, BROADCAST, n * 1000)
                world.run()
            return [(now_us, k) for now_us, k, _, _ in world.heard]

        lossy = heard(0.2, 3)
        for robot in (1, 2):
            assert sum(k == robot for _, k in lossy) == pytest.approx(800, abs=50)
        times = [{now_us for now_us, k in lossy if k == robot} for robot in (1, 2)]
        assert len(times[0] & times[1]) == pytest.approx(640, abs=50), "each by its own luck"
        assert heard(0.2, 3) == lossy != heard(0.2, 4)
        assert len(heard(0.0, 3)) == 2000

    def test_a_lost_unicast_or_acknowledgement_is_tried_again_and_the_frame_delivered_once(self):
        world = World([(0, 0), (50, 0)], RadioConfig(loss=0.2, tries=255))
        for n in range(1000):
            world.send(0, 1000, 1, n * 100_000)
            world.run()
        assert len(world.heard) == 1000
        assert all(arrived for _, _, arrived in world.left)
        tries = world.air.counts[0, radio.APP_UNICAST, radio.AIRTIME_US] / 348
        assert tries == pytest.approx(1000 / 0.8**2, rel=0.1)
        with pytest.raises(UsageError, match="loss is 1"):
            RadioConfig(loss=1.0)


class TestRules:
    def test_a_robot_that_hears_another_waits(self):
        world = World([(0, 0), (50, 0), (100, 0)])
        world.send(0, 27, BROADCAST, 0)
        world.send(1, 27, BROADCAST, 20)
        world.run()
        assert [k for _, k, _, _ in world.heard] == [1, 2, 0, 2]
        assert world.heard[2][0] - world.heard[0][0] >= radio.card.AIFS_US + 148

    def test_two_in_the_same_slot_are_both_lost_where_neither_is_much_stronger(self):
        world = World([(0, 0), (100, 0), (50, 0), (50, 9)])
        world.send(0, 27, BROADCAST, 0)
        world.send(1, 27, BROADCAST, 0)
        assert world.run().heard == []
        assert world.air.counts[:, radio.APP_BROADCAST, radio.DUE].tolist() == [3, 3, 0, 0]

    def test_the_stronger_of_two_in_the_same_slot_is_heard_from_four_decibels_on(self):
        # 4 dB at exponent 3 are 1.36 times as far.
        for far, hearers in ((1.4, [2]), (1.3, [])):
            world = World([(-10, 0), (10 * far, 0), (0, 0)])
            world.send(0, 27, BROADCAST, 0)
            world.send(1, 27, BROADCAST, 0)
            assert world.run().who_heard() == hearers
        world = World([(-10, 0), (100, 0), (0, 0)], RadioConfig(capture_db=300, data_capture_db=300))
        world.send(0, 27, BROADCAST, 0)
        world.send(1, 27, BROADCAST, 0)
        assert world.run().heard == []

    def test_hidden_terminals_talk_over_each_other_in_the_middle_only(self):
        world = World([(0, 0), (110, 0), (220, 0), (-50, 0)])
        world.send(0, 27, BROADCAST, 0)
        world.send(2, 27, BROADCAST, 60)
        assert world.run().who_heard() == [3]

    def test_a_robot_hears_nothing_while_it_sends(self):
        # 0 and 2 begin in the same slot; 1 is so near to 2 that it hears 2 through 0.
        world = World([(0, 0), (100, 0), (110, 0)])
        world.send(2, 27, BROADCAST, 0)
        world.send(0, 27, BROADCAST, 0)
        assert world.run().who_heard() == [1]

    def test_a_unicast_that_collides_is_sent_again_and_delivered_once(self):
        for seed in range(20):
            world = World([(0, 0), (110, 0), (220, 0)], seed=seed)
            world.send(0, 1000, 1, 0)
            world.send(2, 1000, 1, 100)
            world.run()
            assert [k for _, k, _, _ in world.heard] == [1, 1]
            assert sorted(robot for _, robot, arrived in world.left if arrived) == [0, 2]
            assert world.air.counts[:, radio.APP_UNICAST, radio.AIRTIME_US].sum() > 2 * 348

    def test_whoever_hears_a_unicast_leaves_room_for_its_answer_even_out_of_range_of_the_answer(self):
        # 2 hears 0 but not 1; without knowing of the answer it would begin while 0 still listens.
        for seed in range(20):
            world = World([(0, 0), (100, 0), (-100, 0)], seed=seed)
            world.send(0, 1000, 1, 0)
            world.send(2, 27, BROADCAST, 50)
            world.run()
            assert world.air.counts[0, radio.APP_UNICAST, radio.AIRTIME_US] == 348
            assert 0 in world.who_heard()

    def test_a_frame_whose_answer_is_lost_is_sent_again_but_delivered_once(self):
        # 2 listens to 3 and so does not know that an answer to 0 follows; it may begin before that has ended.
        again = 0
        for seed in range(100):
            world = World([(0, 0), (100, 0), (-100, 0), (-200, 0)], seed=seed)
            world.send(3, 27, BROADCAST, 0)
            world.send(0, 1000, 1, 20)
            world.run(until_us=200)
            world.send(2, 27, BROADCAST, 200)
            world.run()
            assert [length for _, k, length, _ in world.heard if k == 1] == [1000]
            assert [arrived for _, robot, arrived in world.left if robot == 0] == [1]
            again += world.air.counts[0, radio.APP_UNICAST, radio.AIRTIME_US] > 348
        assert again > 0

    def test_frames_leave_in_the_order_they_came_and_there_is_room_for_sixteen_of_which_one_is_long(self):
        world = World([(0, 0), (1, 0)])
        lengths = [20, 2000, *range(30, 44)]
        assert [world.send(0, length, BROADCAST, 0, first=length % 128) for length in lengths] == [0] * 16
        assert world.send(0, 10, BROADCAST, 0) == -1
        world.run()
        assert [(k, length, last) for _, k, length, last in world.heard] == [(1, n, n % 128) for n in lengths]
        assert world.air.counts[0, radio.APP_BROADCAST, radio.DROPPED] == 1
        now_us = world.heard[-1][0]
        assert world.send(0, 65, BROADCAST, now_us) == 0
        assert world.send(0, 65, BROADCAST, now_us) == -1
        assert world.send(0, 64, BROADCAST, now_us) == 0

    @pytest.mark.parametrize("length", [0, -1, 3501])
    def test_a_frame_of_no_legal_length_is_refused(self, length):
        world = World([(0, 0), (1, 0)])
        assert enqueue(world.air, world.queue, 0, np.zeros(4000, np.uint8), length, BROADCAST, 0) == -1
        assert world.run().heard == []

    @pytest.mark.parametrize("dst", [0, 2, 1 << 30, -2])
    def test_a_frame_to_nobody_is_tried_and_given_up(self, dst):
        world = World([(0, 0), (1, 0)])
        world.send(0, 40, dst, 0)
        world.run()
        assert world.heard == []
        assert [robot for _, robot, arrived in world.left if not arrived] == [0]

    def test_audits_are_counted_apart(self):
        world = World([(0, 0), (1, 0), (2, 0)])
        world.send(0, 50, BROADCAST, 0, first=0x81)
        world.send(1, 60, 2, 100, first=0x80)
        world.run()
        counts = world.air.counts
        columns = [radio.SENT, radio.DUE, radio.ARRIVED, radio.BYTES]
        assert counts[0, radio.AUDIT_BROADCAST, columns].tolist() == [1, 2, 2, 50]
        assert counts[1, radio.AUDIT_UNICAST, columns].tolist() == [1, 1, 1, 60]
        assert counts[2, :, radio.HEARD].tolist() == [0, 0, 1, 1]
        assert counts[:, [radio.APP_BROADCAST, radio.APP_UNICAST]].sum() == 0

    def test_a_silenced_robot_sends_nothing_hears_nothing_and_nobody_waits_for_it(self):
        world = World([(0, 0), (10, 0), (20, 0)])
        world.send(1, 27, BROADCAST, 0)
        world.send(0, 27, BROADCAST, 0)
        silence(world.air, 1)
        assert world.send(1, 27, BROADCAST, 1) == -1
        world.send(0, 27, 1, 1)
        world.run()
        assert world.who_heard() == [2]
        assert world.air.counts[0, radio.APP_BROADCAST, radio.DUE] == 1
        assert [arrived for _, robot, arrived in world.left] == [1, 0]

    def test_a_robot_that_drives_out_of_range_meanwhile_hears_nothing(self):
        world = World([(0, 0), (10, 0), (20, 0)])
        world.send(0, 27, BROADCAST, 0)
        world.run(until_us=20)
        world.pos[1] = (500, 0)
        rebuild(world.reach, world.pos)
        assert world.run().who_heard() == [2]

    @pytest.mark.parametrize(
        "bad",
        [
            {"exponent": 2.7},
            {"mcs": 12},
            {"guard_us": 1.0},
            {"broadcast_mbps": 7},
            {"long_bytes": 10_000},
            {"tries": 0},
            {"tx_gain_dbm": float("nan")},
            {"sensitivity_dbm": 150.0},
        ],
        ids=str,
    )
    def test_a_bad_configuration_cannot_be_made(self, bad):
        with pytest.raises(UsageError) as caught:
            RadioConfig(**bad)
        assert caught.value.hint


class TestDeterminism:
    def test_the_same_seed_gives_the_same_counts_and_another_does_not(self):
        first, again, other = (replay(100, 4, seconds=6, audits=True, seed=s) for s in (3, 3, 4))
        assert np.array_equal(first.air.counts, again.air.counts)
        assert np.array_equal(first.air.nic, again.air.nic)
        assert not np.array_equal(first.air.counts, other.air.counts)

    def test_the_kernels_do_the_same_uncompiled(self):
        script = (
            "import hashlib\n"
            "from radio_replay import replay\n"
            "run = replay(9, 60, seconds=2, audits=True, jitter_s=0.002)\n"
            "print(run.events, hashlib.sha256(run.air.counts.tobytes()).hexdigest())\n"
        )

        def digest(switch):
            env = os.environ | {"PHALANX_PURE": switch, "PYTHONPATH": str(ROOT / "tests" / "kit")}
            done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=150)
            assert done.returncode == 0, done.stderr
            return done.stdout

        assert digest("1") == digest("0")
