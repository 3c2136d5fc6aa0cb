"""The trusted nodes on microcontrollers, without an operating system, in QEMU: what the host's program answers they answer."""

from __future__ import annotations

import random
import time
from dataclasses import replace

import pytest

import boards
import qemu
from flock_elsewhere import FLOCK, played, same
from oracle.nodes import No
from oracle.sealed import SealedANode
from phalanx.bti.nodes import Refused
from phalanx.bti.trusted import REASONS
from phalanx.config import BtiConfig
from phalanx.errors import Unavailable
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import lines, table
from phalanx.wire.framing import encode_frame
from serial_keys import LIMITS, MASTER, sealed

# Who asks has his turn at once: a board without work polls its line as fast as it can.
pytestmark = [pytest.mark.timeout(900), pytest.mark.waits]
# Two rounds of audits, of three robots.
SMALL = Scenario(robots=3, duration_s=6.0, bti=BtiConfig(f_max=1))


# The one that loses its power in the story; the others' parts are more of the same.
@pytest.mark.parametrize("robots", [[1], pytest.param([0, 2, 3], marks=pytest.mark.long)], ids=str)
@pytest.mark.parametrize("machine", qemu.MACHINES)
def test_each_processor_answers_as_the_oracle_does(machine, robots, tmp_path):
    for robot in robots:
        with qemu.machines(tmp_path, machine, 1) as (made,):
            assert boards.live(robot, made.board(), made.again) > 50


@pytest.mark.long
@pytest.mark.parametrize("machine", qemu.MACHINES)
def test_each_processor_seals_as_the_oracle_does(machine, tmp_path):
    ours, other = (SealedANode(hardened=True, limits=LIMITS) for _ in range(2))
    for robot, rob_id in ((ours, 7), (other, 8)):
        robot.load_master(MASTER, rob_id)
        robot.load_mission(0, *sealed(1))
    with qemu.machines(tmp_path, machine, 1) as (made,):
        board = made.board()
        board.make(LIMITS, sealed=True)
        board.load_master(MASTER, 7)
        board.load_mission(0, sealed(1))
        frames = [other.sealed_send(now, b"\x01hello")[7:] for now in (100, 100, 140, 172, 300, 9000)]
        for now, k in enumerate([0, 1, 1, 2, 3, 0, 2, 4, 3, 5, 4], 200):
            for frame in (frames[k], frames[k][:-1]):
                assert told(board, lines.RECV, now, frame) == told(ours, "sealed_recv", now, frame)
            assert told(board, lines.SEND, now, b"\x01hi") == told(ours, "sealed_send", now, b"\x01hi")


def told(node, what, now, frame):
    """What a board makes of a frame, or the oracle; or why not."""
    if isinstance(node, SealedANode):
        try:
            return getattr(node, what)(now, frame)
        except No as no:
            return no.args[0]
    code, made = node.ask(what, now, packet=frame)
    return made or REASONS[code].upper()


def test_reset_at_any_moment_no_mission_number_is_taken_twice(tmp_path):
    chance, answered = random.Random(2), 1
    with qemu.machines(tmp_path, "mps2-an385", 1) as (made,):
        board = made.board()
        board.make(LIMITS)
        board.load_master(MASTER, 7)
        board.load_mission(0, sealed(1))
        for seq in range(2, 12):
            made.reset()
            board = made.board()
            assert board.about.seq >= answered
            call = lines.LOAD_MISSION.encode(number=9, **sealed(seq)._asdict())
            board._line.send(encode_frame(call), time.monotonic() + 60)
            time.sleep(chance.random() * 0.03)
            made.reset()
            board = made.board()
            if board.about.seq == seq:
                answered = seq
            with pytest.raises(Refused, match="seq"):
                board.load_mission(0, sealed(answered))
        board.load_mission(0, sealed(40))


def test_rubbish_on_the_line_locks_nothing_up(tmp_path):
    chance = random.Random(3)
    with qemu.machines(tmp_path, "mps2-an385", 1) as (made,):
        board = made.board(again_s=0.3)
        for _ in range(6):
            rubbish = chance.randbytes(chance.randrange(300))
            board._line.send(rubbish + b"\0" * chance.randrange(2), time.monotonic() + 60)
            assert board.ask(lines.POLL, 5, reading=b"x") == (boards.CODES["NO_KEY"], b"")


def test_a_robots_board_is_not_told_the_time(tmp_path):
    with qemu.machines(tmp_path, "mps2-an385", 1, image="mps2-an385") as (made,):
        board = made.board()
        assert board.about.told == lines.TOLD_READINGS
        with pytest.raises(Unavailable, match="does not know this call"):
            board._call(lines.CLOCK, t=5)


def test_a_robots_board_counts_the_time_and_stops_by_itself(tmp_path):
    with qemu.machines(tmp_path, "mps2-an385", 1, image="mps2-an385") as (made,):
        board = made.board()
        board.make(replace(LIMITS, t_val_ms=400))
        board.load_master(MASTER, 7)
        board.load_mission(0, sealed(1))
        times = []
        while (said := board.ask(lines.ACTUATE, command=b"go"))[0] > 0:
            times.append(table.ENTRY.decode(said[1])["t"])
            time.sleep(0.05)
        assert said[0] == boards.CODES["SAFE_MODE"], "no token came, and nobody asked it to check"
        assert times == sorted(set(times))
        assert times[-1] - times[0] <= 400 + 10, "it goes no further than t_val and the time between two checks"


@pytest.mark.long
def test_a_flock_in_qemu_has_the_same_logs_audits_and_digest(tmp_path):
    with qemu.machines(tmp_path, "mps2-an385", SMALL.robots) as made:
        there = played(
            lambda n, _profile, limits: boards.SerialNodes([each.board() for each in made], n, limits), SMALL
        )
    here = played(scenario=SMALL)
    same(there, here)
    assert here.world.fleet.robot["audits_passed"].sum() > 0


@pytest.mark.long
@pytest.mark.parametrize("machine", qemu.MACHINES)
def test_a_liar_is_stopped_by_its_board_on_each_processor(machine, tmp_path):
    with qemu.machines(tmp_path, machine, FLOCK.robots) as made:
        there = played(lambda n, _profile, limits: boards.SerialNodes([each.board() for each in made], n, limits))
    same(there, played())
