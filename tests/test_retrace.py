"""A robot's log gone through again: an honest one has no fault, and a fault is found where it is."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import Writer

from phalanx.bti import audit
from phalanx.bti.log import CHECKPOINT, MARK, logged
from phalanx.bti.nodes import seal_mission_key
from phalanx.bti.refusal import Refusal
from phalanx.bti.request import HEAD_BYTES
from phalanx.config import BtiConfig
from phalanx.daemon import evidence
from phalanx.daemon.driver import no_reading
from phalanx.daemon.evidence import RobotLog, read_robot_log, record_log
from phalanx.daemon.kept_log import KeptLog
from phalanx.daemon.proofs import ProofResult, check_proofs
from phalanx.errors import UsageError
from phalanx.recording.recorded import MOST_CHUNK_BYTES
from phalanx.robot.retrace import entries_of
from phalanx.scenarios.file import written_scenario
from phalanx.wire.table import ACCELERATION, ENTRY, ENTRY_ACMD, ENTRY_INPUT, ENTRY_RECV, PROOF, SENSOR
from phalanx.world import Scenario
from phalanx.world.audited import setup
from phalanx.world.scenarios.run import Run

# Nobody is audited yet: what robots have logged they still have.
MISSION = Scenario(name="young", robots=4, grid_step_m=16.0, duration_s=3.9, bti=BtiConfig(f_max=1))
ME = 1


@pytest.fixture(scope="module")
def kept():
    run = Run(MISSION)
    for k in range(1, 40):
        run.advance(k / 10)
        robot = run.world.fleet.robot[ME]
        raw = logged(run.world.fleet, ME)
        if robot.checkpoint_no > 1 or robot.tokens_got:
            break
        shown = raw
    return RobotLog(ME + 1, 1, int(robot.t_key), MISSION, shown)


def changed(kept, raw):
    return RobotLog(kept.robot, kept.mission, kept.t_key_ms, kept.scenario, bytes(raw)).first_dishonest_entry()


def of_kind(kept, kind, nth=1):
    return [(number, each) for number, each in enumerate(kept.entries()) if each.kind == kind][nth]


def test_an_honest_log_has_no_fault_wherever_it_was_cut_short(kept):
    assert {each.kind for each in kept.entries()} >= {ENTRY_INPUT, ENTRY_RECV, ENTRY_ACMD}
    assert kept.first_dishonest_entry() is None
    _, reading = of_kind(kept, ENTRY_INPUT)
    for length in (*range(0, len(kept.raw), 31), *range(reading.at, reading.end)):
        assert changed(kept, kept.raw[:length]) is None


def test_an_altered_command_is_found_where_it_is(kept):
    number, entry = of_kind(kept, ENTRY_ACMD, 3)
    raw = bytearray(kept.raw)
    raw[entry.end - 1] ^= 1
    found = changed(kept, raw)
    assert (found.entry, found.t_ms, found.refusal) == (number, entry.t_ms, Refusal.OUTPUT_WRONG)


def test_a_command_that_was_left_out_and_one_too_many_are_found(kept):
    number, entry = of_kind(kept, ENTRY_ACMD, 2)
    without = changed(kept, kept.raw[: entry.at] + kept.raw[entry.end :])
    assert number <= without.entry <= number + 2
    assert without.refusal in (Refusal.OUTPUT_WRONG, Refusal.OUTPUT_LATE)
    twice = changed(kept, kept.raw[: entry.end] + kept.raw[entry.at :])
    assert (twice.entry, twice.refusal) == (number + 1, Refusal.OUTPUT_UNCALLED)


def test_a_reading_at_another_time_is_off_the_grid(kept):
    number, entry = of_kind(kept, ENTRY_INPUT, 2)
    raw = kept.raw[: entry.at] + kept.raw[entry.end :]
    found = changed(kept, raw)
    assert found.entry <= number + 3
    assert found.refusal in (Refusal.INPUT_OFF_GRID, Refusal.OUTPUT_UNCALLED)


def test_no_bytes_make_it_raise(kept):
    chance = np.random.default_rng(7)
    for _ in range(60):
        raw = bytearray(kept.raw)
        for at in chance.integers(0, len(raw), 3):
            raw[at] = chance.integers(256)
        changed(kept, raw)
        changed(kept, chance.bytes(int(chance.integers(1, 400))))
    assert list(entries_of(bytes((CHECKPOINT, ENTRY_INPUT, 0)))) == list(entries_of(bytes((CHECKPOINT,))))


def test_a_log_shorter_than_a_requests_head_is_compared_with_nothing_behind_its_end(kept, monkeypatch):
    shown = []
    monkeypatch.setattr(audit, "check_chains", lambda _fleet, _work, q: shown.append(len(q)) or 0)
    assert changed(kept, bytes((CHECKPOINT,))) is None
    assert shown == [1 + HEAD_BYTES]


@pytest.mark.parametrize(("most", "count"), [(1 << 29, 1), (1 << 22, 2)])
def test_a_recording_that_unpacks_to_much_more_than_a_log_is_refused(tmp_path, monkeypatch, most, count):
    monkeypatch.setattr(evidence, "MOST_UNPACKED", most)
    path = tmp_path / "x.mcap"
    head = {"robot": 1, "mission": 1, "t_key_ms": 5, "scenario": written_scenario(MISSION)}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("robot", {"head": json.dumps(head)})
        channel = writer.register_channel("/entries", "json", 0)
        for _ in range(count):
            writer.add_message(channel, 0, b'{"bytes": "%s"}' % (b"0" * (MOST_CHUNK_BYTES // count**2)), 0)
        writer.finish()
    assert path.stat().st_size < 1 << 13
    with pytest.raises(UsageError, match=r"x\.mcap unpacks to more"):
        read_robot_log(path)


def test_a_recording_of_a_log_says_what_the_log_says(kept, tmp_path):
    head = {"robot": kept.robot, "mission": 1, "t_key_ms": kept.t_key_ms, "scenario": written_scenario(MISSION)}
    path, recording = tmp_path / "robot-2.log", tmp_path / "robot-2.mcap"
    path.write_bytes(json.dumps(head).encode() + b"\n" + kept.raw)
    assert read_robot_log(path) == kept
    assert record_log(path, recording) == len(kept.entries())
    assert read_robot_log(recording) == kept
    whole = recording.read_bytes()
    for share in (2, 4, 8):
        recording.write_bytes(whole[: len(whole) - len(whole) // share])
        with pytest.raises(UsageError, match=r"robot-2\.mcap (was cut short|is not a recording)"):
            read_robot_log(recording)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}\n",
        b"[]\n",
        b"\x89MCAP0\r\n" + bytes(40),
        b'{"robot": 9, "mission": 1, "t_key_ms": 5, "scenario": {"robots": 2, "bti": {"f_max": 1}}}\n',
        b'{"robot": 1, "mission": 1, "t_key_ms": -5, "scenario": {"robots": 2, "bti": {"f_max": 1}}}\n',
        b'{"robot": 1, "mission": 1, "t_key_ms": 5, "scenario": {"robbots": 2}}\n',
        b'{"robot": 1e999, "mission": 1, "t_key_ms": 5, "scenario": {"robots": 2, "bti": {"f_max": 1}}}\n',
        b"\x89MCAP0\r\n",
        b"[" * 100_000,
    ],
)
def test_what_is_no_log_is_said_in_a_line(tmp_path, data):
    path = tmp_path / "x.log"
    path.write_bytes(data)
    with pytest.raises(UsageError, match=r"x\.log"):
        read_robot_log(path)


def test_who_acts_as_if_there_had_been_a_reading_or_acts_not_at_all_is_convicted(kept):
    (_, given), (_, after) = (of_kind(kept, ENTRY_INPUT, nth) for nth in (2, 3))
    before = kept.raw[: given.at]
    nothing = ENTRY.encode(type=ENTRY_INPUT, t=given.t_ms, payload=no_reading(SENSOR, kept.robot, given.t_ms))
    later = kept.raw[after.at : after.end]
    stands = ACCELERATION.encode(id=kept.robot, t=given.t_ms, ax_mps2=0.0, ay_mps2=0.0)
    moves = ACCELERATION.encode(id=kept.robot, t=given.t_ms, ax_mps2=1.0, ay_mps2=0.0)
    acts = [before + nothing + ENTRY.encode(type=ENTRY_ACMD, t=given.t_ms, payload=each) for each in (stands, moves)]
    assert changed(kept, acts[0]) is None
    assert changed(kept, acts[1]).refusal == Refusal.OUTPUT_WRONG
    assert changed(kept, before + nothing + later).refusal in (Refusal.OUTPUT_LATE, Refusal.OUTPUT_MISSING)
    assert changed(kept, before + later).refusal == Refusal.INPUT_OFF_GRID


@pytest.mark.parametrize("controller", ["warehouse", "patrol", "tracking"])
def test_a_log_of_a_protocols_robot_is_gone_through_by_the_protocol_itself(tmp_path, controller):
    scenario = {"robots": 2, "controller": controller, "bti": {"f_max": 1}}
    path = tmp_path / "x.log"
    path.write_bytes(json.dumps({"robot": 1, "mission": 1, "t_key_ms": 5, "scenario": scenario}).encode() + b"\n")
    assert read_robot_log(path).first_dishonest_entry() is None
    path.write_bytes(path.read_bytes() + ENTRY.encode(type=ENTRY_ACMD, t=9, payload=b"\x03"))
    assert read_robot_log(path).first_dishonest_entry().refusal.name == "OUTPUT_UNCALLED"
    far = scenario | {"obstacles": [{"left_m": -1e5, "bottom_m": -1e5, "right_m": 1e5, "top_m": 1e5}]}
    path.write_bytes(path.read_bytes().replace(json.dumps(scenario).encode(), json.dumps(far).encode()))
    if controller == "warehouse":  # whoever gives evidence may not choose how long it takes
        with pytest.raises(UsageError, match="warehouse of"):
            read_robot_log(path).first_dishonest_entry()


@pytest.fixture(scope="module")
def borne(tmp_path_factory):
    """A robot's log as a daemon keeps it, and the mission key that its trusted nodes have."""
    path, keys = tmp_path_factory.mktemp("kept") / "2.log", []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setup, "seal_mission_key", lambda *given: keys.append(given[1]) or seal_mission_key(*given))
        run = Run(MISSION)
    with KeptLog(path) as kept:
        kept.begin({})
        row = 0
        for k in range(1, 6000):
            run.advance(k / 1000)
            fleet = run.world.fleet
            if fleet.robot[ME].tokens_got:
                break
            row = max(row, int(fleet.robot[ME].request_row))
            shown = SimpleNamespace(rows=fleet.request.rows[row : row + 1])
            mine = {name: getattr(fleet, name)[ME : ME + 1] for name in ("robot", "log", "log_rest")}
            kept.keep(SimpleNamespace(**mine, request=shown))
        t_key_ms = int(fleet.robot[ME].t_key)
    return RobotLog(ME + 1, 1, t_key_ms, MISSION, path.read_bytes().partition(b"\n")[2]), keys[0]


def test_who_has_the_mission_key_sees_that_a_log_is_what_trusted_nodes_saw(borne, tmp_path):
    log, key = borne
    found = check_proofs(log, key)
    assert found.holds
    assert 0 < found.entries <= len(log.entries())
    assert log.first_dishonest_entry() is None
    written = tmp_path / "2.log"
    written.write_bytes(json.dumps(log.head).encode() + b"\n" + log.raw)
    assert record_log(written, tmp_path / "2.mcap") > len(log.entries())
    assert check_proofs(read_robot_log(tmp_path / "2.mcap"), key) == found


def test_another_log_than_they_saw_is_not_proven_and_one_without_proofs_proves_nothing(borne):
    log, key = borne
    proofs = [each for each in entries_of(log.raw) if each.kind == PROOF.tag]
    before = [each for each in log.entries() if each.end <= proofs[0].at and not each.kind & MARK]
    for each in before[:2]:
        for at in (each.at + 1, each.end - 1):
            raw = bytearray(log.raw)
            raw[at] ^= 1
            assert check_proofs(replace(log, raw=bytes(raw)), key).false_at is not None
        assert not check_proofs(replace(log, raw=log.raw[: each.at] + log.raw[each.end :]), key).holds
    assert not check_proofs(replace(log, raw=log.plain()), key).holds
    assert check_proofs(log, bytes(20)) == ProofResult(0, 0, check_proofs(log, bytes(20)).false_at)
    for at in (proofs[0].at + 1, proofs[0].end - 70, proofs[0].at + 8):  # whom it asked, MACs, the robot
        raw = bytearray(log.raw)
        raw[at] ^= 1
        changed = check_proofs(replace(log, raw=bytes(raw)), key)
        assert changed.holds or changed.entries == 0
