"""Robots that know only an encoded mission, in a simulated building: they arrive, or they stop and say why."""

from __future__ import annotations

import json
import math
import multiprocessing
import random
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from phalanx.cli.commands.mission import mission as group
from phalanx.cli.mission.files import read_plain
from phalanx.cli.mission.run import _show, _warn_of_few
from phalanx.config.mission import CodingConfig
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.mission import BuildOptions, Draft, Landmark, Mission, Phase, Position, Profile, build
from phalanx.mission.landmarks import floorplan_of_yaml
from phalanx.mission.refused import NotForUs
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import NoiseModel, OdometryNoise
from phalanx.world.missions.orders import with_fixtures
from phalanx.world.missions.report import Report, summary
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.setup import MissionRun, Part, pool_of
from phalanx.world.missions.world import MissionRobot, MissionWorld
from worlds import cheap

OFFICE = load_floorplan("office_40x40")
START = (3.0, 1.5, math.pi / 2)
NOISE = OdometryNoise(0.03, 0.05)


def two_doors(timeout_s: int = 0) -> Mission:
    """From the main door through the lobby's, which is the end; sealed tries are made cheap."""
    draft = Draft("two doors", coding=CodingConfig(delta_mm=400, kdf_log2_n=2))
    draft.node("start", Position(3.0, 1.5), start=True, timeout_s=timeout_s)
    draft.node("door", Landmark("doorway", 9.0, 12.0, math.pi / 2))
    draft.node("end", Landmark("doorway", 10.6, 13.5, 0.0), final=True, within_m=3.0)
    draft.way("start", "door")
    draft.way("door", "end")
    return draft.mission()


def run_of(mission: Mission, profile: Profile = Profile.PAPER, **more: object) -> MissionRun:
    built = build(mission, BuildOptions(profile=profile), random.Random(0).randbytes)
    starts = [node.place or START[:2] for node in mission.nodes if node.start]
    parts = tuple(
        Part(each.mission, each.key, (*start, math.pi / 2)) for each, start in zip(built, starts, strict=True)
    )
    return MissionRun(plan=OFFICE, parts=parts, noise=NOISE, pool=pool_of(mission), **more)


def world_of(mission: Mission, **more: object) -> tuple[MissionWorld, MissionRobot]:
    world = MissionWorld(replace(run_of(mission), **more), (0,))
    return world, world.robots[0]


def live(world: MissionWorld, seconds: float) -> None:
    until_s = world.now_s + seconds
    while world.now_s < until_s and not world.over:
        world.advance(world.now_s + 1.0)


@pytest.mark.parametrize(
    ("profile", "seed"),
    [
        (Profile.PAPER, 0),
        (Profile.SEALED, 1),
        pytest.param(Profile.PAPER, 1, marks=pytest.mark.long),
        pytest.param(Profile.SEALED, 0, marks=pytest.mark.long),
    ],
)
def test_a_robot_finds_all_landmarks_of_the_office_and_takes_none_for_another(profile: Profile, seed: int) -> None:
    run = run_of(cheap(read_plain("office"), profile), profile, seed=seed)
    told = summary(run, run_mission(run))
    assert (told["completed"], told["decoded"], told["false_fixes"]) == (1, 33, 0)
    # Odometry alone would be lost; with fixes it is not.
    assert told["pose_error_m_max"] < 0.5
    assert told["pose_error_m_p50"] < 0.05
    assert told["hashes_tried"] > 0


@pytest.mark.parametrize("profile", list(Profile))
def test_both_profiles_lead_to_the_end(profile: Profile) -> None:
    run = run_of(two_doors(), profile)
    (report,) = run_mission(run)
    assert report.done
    assert [node for _, node in report.decoded] == [0, 1, 2]
    assert report.false_fixes == 0


def test_a_seed_gives_the_same_digest_however_many_processes_share_the_work() -> None:
    run = run_of(two_doors(), robots=3)
    alone, shared = (summary(run, run_mission(run, workers)) for workers in (1, 2))
    other = run_of(two_doors(), robots=3, seed=1)
    assert alone["digest"] == shared["digest"]
    assert alone["pose_error_m_max"] == shared["pose_error_m_max"]
    assert alone["digest"] != summary(other, run_mission(other))["digest"]


def test_who_waits_for_a_process_that_was_killed_is_told_so() -> None:
    def kill(_share: float) -> None:
        for other in multiprocessing.active_children():
            other.kill()

    with pytest.raises(Unavailable, match="was killed"):
        run_mission(run_of(two_doors(), robots=2, duration_s=3), 2, kill)
    assert not multiprocessing.active_children()


def test_a_robot_with_a_dead_wheel_validates_nothing_more_and_stops() -> None:
    world, robot = world_of(two_doors(timeout_s=20))
    robot.body.wheels.left = 0.0
    live(world, 300)
    (report,) = world.finish()
    assert robot.controller.memory.walk.phase is Phase.HELD
    assert [node for _, node in report.decoded] == [0]
    assert [reason for _, reason in report.not_validated if reason in ("timed out", "blocked")]
    where = robot.body.wheels.pose
    world.advance(world.now_s + 2.0)
    assert robot.body.wheels.pose == where


def test_a_robot_that_has_no_way_to_the_end_stops_and_says_so() -> None:
    draft = Draft("island")
    draft.node("start", Position(3.0, 1.5), start=True)
    draft.node("end", Landmark("doorway", 37.0, 29.5, 0.0), final=True)
    (report,) = run_mission(run_of(draft.mission()))
    assert not report.done
    assert [reason for _, reason in report.not_validated] == ["no way left"]
    (late,) = run_mission(run_of(two_doors(), duration_s=3))
    assert [reason for _, reason in late.not_validated] == ["out of time"]


def test_in_a_world_without_walls_nothing_is_decoded_and_nothing_breaks() -> None:
    empty = floorplan_of_yaml(b"size: [10, 10]\nstart_pose: [3.0, 1.5, 1.57]\n")
    world, robot = world_of(two_doors(timeout_s=20), plan=empty)
    live(world, 300)
    assert robot.controller.memory.walk.phase is Phase.HELD
    assert [node for _, node in robot.report.decoded] == [0]


def test_a_robot_in_another_building_than_its_missions_validates_nothing_but_its_start() -> None:
    world, robot = world_of(two_doors(timeout_s=20), plan=load_floorplan("office_30x25"))
    live(world, 300)
    assert robot.controller.memory.walk.phase is Phase.HELD
    assert [node for _, node in robot.report.decoded] == [0]


def test_two_robots_with_half_a_mission_each_need_the_others_message() -> None:
    plain = read_plain("inspection")
    both = run_of(plain, robots=2, duration_s=200)
    assert not both.alone
    assert [report.done for report in run_mission(both, workers=2)] == [True, True]
    (left_alone,) = run_mission(run_of(plain, robots=1, duration_s=200))
    assert not left_alone.done


def test_a_code_on_the_wall_and_the_controllers_message_lead_through_the_delivery() -> None:
    plain = read_plain("delivery")
    built = build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)[0]
    part = Part(built.mission, built.key, START)

    def done(messages: tuple[bytes, ...], plan: object) -> tuple[bool, list[str]]:
        # It is done after 100 s; so long it has looked for the code by then, or waited for the message.
        run = MissionRun(plan=plan, parts=(part,), controller=messages, duration_s=110, pool=pool_of(plain))
        (report,) = run_mission(run)
        return report.done, [action for _, action in report.actions]

    said = tuple(built.key.messages.values())
    assert done(said, with_fixtures(OFFICE, plain)) == (True, ["pick", "hand_over"])
    assert done((), with_fixtures(OFFICE, plain)) == (False, ["pick"])
    assert done(said, OFFICE) == (False, [])


def test_robots_that_meet_tell_each_other_what_they_decoded_and_nothing_else() -> None:
    world = MissionWorld(run_of(two_doors(), robots=3, meet_m=3.0, apart_s=100.0))
    one, other, far = world.robots
    far.body.wheels.pose = (30.0, 30.0, 0.0)
    world.advance(1.0)
    assert one.controller.memory.walk.opened
    assert other.controller.memory.walk.others == {0}
    assert not far.controller.memory.walk.others
    assert not other.controller.memory.walk.opened


def test_robots_that_cannot_audit_each_other_are_told_so() -> None:
    for robots, wrong in ((1, "1 robot "), (2, "2 robots"), (33, "33 robots")):
        with pytest.raises(UsageError, match=wrong):
            run_of(two_doors(), robots=robots, defence="hardened")
    with pytest.raises(UsageError, match="no defence"):
        run_of(two_doors(), defence="iron")


@pytest.mark.parametrize("wrong", [{"robots": 0}, {"duration_s": math.nan}, {"seed": -1}, {"robots": 10_000}])
def test_a_run_that_makes_no_sense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        run_of(two_doors(), **wrong)


ASKED = {
    "robots", "nodes", "decoded", "completed", "hashes_tried", "search_ms_p50", "search_ms_max", "extraction_ms_p50",
    "pose_error_m_p50", "pose_error_m_max", "odometry_error_m_max", "false_fixes", "not_validated", "digest",
}  # fmt: skip


def _command(*words: str) -> tuple[int, str, BaseException | None]:
    done = CliRunner().invoke(group, ["run", *words], standalone_mode=False)
    return (done.return_value if done.exception is None else 1), done.stdout, done.exception


def test_the_command_prints_the_figures_that_were_asked_for() -> None:
    words = ("inspection", "--profile", "paper", "--world", "office_40x40", "--noise", "0.03,0.05,step", "--json")
    code, out, _ = _command(*words)
    told = json.loads(out)
    assert code == 0
    assert told.keys() >= ASKED
    assert (told["robots"], told["completed"]) == (2, 2)
    again = [json.loads(_command(*words, "--duration", "12")[1])["digest"] for _ in range(2)]
    assert again[0] == again[1] != told["digest"]


def test_the_command_has_robots_audit_each_other_and_says_who_cannot() -> None:
    words = ("inspection", "--profile", "paper", "--robots", "4", "--defence", "hardened", "--duration", "80", "--json")
    code, out, _ = _command(*words)
    told = json.loads(out)
    assert (code, told["completed"], told["in_safe_mode"], told["false_fixes"]) == (0, 4, [], 0)
    assert (told["defence"], told["f_max"], told["audits"]["refused"]) == ("hardened", 1, 0)
    assert told["audits"]["passed"] > 4 * 80 / 10, "each robot is audited more than once in 10 s"
    _, _, error = _command("inspection", "--defence", "hardened")
    assert isinstance(error, UsageError)
    assert "--defence none" in error.hint


def test_too_few_robots_to_audit_each_other_are_refused_before_anything_is_encoded(monkeypatch) -> None:
    monkeypatch.setattr("phalanx.cli.mission.run.build", lambda *_: pytest.fail("encoded"))
    for words, who in ((("--robots", "2"), "2 robots"), ((), "1 robot")):
        _, _, error = _command("office", *words, "--defence", "hardened")
        assert str(error) == f"{who} cannot audit each other with f_max 1"
        assert error.hint == "use at least 3, or --defence none"


def test_of_a_team_in_which_p2_does_not_hold_that_is_said(capsys) -> None:
    few = "1 compromised of 4 robots can cause others to be stopped: promise P2 needs 5 robots with f_max 1"
    for robots, told in ((4, few), (5, "")):
        _warn_of_few(run_of(two_doors(), robots=robots, defence="hardened"))
        assert told in (err := capsys.readouterr().err)
        assert bool(err) == bool(told)
    _warn_of_few(run_of(two_doors(), robots=4))
    assert not capsys.readouterr().err


def test_what_audits_did_is_shown(capsys) -> None:
    reports = [Report(robot, audits_passed=7, audits_refused=robot) for robot in range(3)]
    told = summary(run_of(two_doors(), robots=3, defence="hardened"), reports)
    assert (told["defence"], told["f_max"], told["audits"]) == ("hardened", 1, {"passed": 21, "refused": 3})
    _show(told)
    out = capsys.readouterr().out.splitlines()
    assert "defence               hardened, f_max 1" in out
    assert "audits                21 passed, 3 refused" in out
    assert "in Safe Mode          none" in out


def test_a_mission_that_is_not_completed_in_time_is_exit_1_and_says_so() -> None:
    code, out, _ = _command("inspection", "--profile", "paper", "--duration", "2")
    assert code == 1
    assert "0 of 2 robots completed" in out


def test_an_encoded_mission_runs_from_its_file_and_not_when_it_was_altered(tmp_path: Path) -> None:
    (built,) = build(two_doors(), BuildOptions(robots=(7,)), random.Random(0).randbytes)
    file, key = tmp_path / "doors.phxm", tmp_path / "doors.phxm.key"
    file.write_bytes(built.mission.encode())
    assert isinstance(_command(str(file))[2], UsageError), "its start key is missing"
    key.write_bytes(built.key.encode())
    in_time = ("--duration", "60")  # three times as long as it needs
    ran = CliRunner().invoke(group, ["run", str(file), *in_time])
    assert (ran.exit_code, "in office_40x40; use --world for another building" in ran.stderr) == (0, True)
    told = CliRunner().invoke(group, ["run", str(file), "--world", "office_40x40", "--duration", "1"]).stderr
    assert "--world" not in told
    assert isinstance(_command(str(file), "--robots", "2")[2], UsageError), "it is for one robot"
    wrong = _command(str(file), "--as", "3")[2]
    assert isinstance(wrong, NotForUs)
    assert str(wrong) == "the mission is for robots 7, this is robot 3"
    assert _command(str(file), "--as", "7", "--duration", "1")[2] is None
    assert isinstance(_command(str(file), "--as", "3,7")[2], NotForUs)
    assert isinstance(_command(str(file), "--as", "7", "--robots", "2")[2], UsageError), "who is the other?"
    assert isinstance(_command(str(file), "--trust", "00" * 32)[2], PeerError), "nobody signed it"
    altered = bytearray(built.mission.encode())
    altered[len(altered) // 2] ^= 1
    file.write_bytes(altered)
    code, _, error = _command(str(file), *in_time)
    assert code == 1
    assert error is None or isinstance(error, PeerError)


def test_a_recording_has_the_walls_and_what_was_decoded_and_is_the_same_again(tmp_path: Path) -> None:
    begun = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    for file in begun:
        _command("inspection", "--profile", "paper", "--record", str(file), "--duration", "12")
    assert begun[0].read_bytes() == begun[1].read_bytes()
    whole = tmp_path / "whole.mcap"
    code, out, _ = _command("inspection", "--profile", "paper", "--record", str(whole), "--json")
    assert code == 0
    with whole.open("rb") as stream:
        topics = ["/scene", "/tf", "/log"]
        messages = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=topics))
        stream.seek(0)
        learnt = [json.loads(m.data) for _, _, m in make_reader(stream).iter_messages(topics=["/drift"])]
    scenes = [message.entities[0] for _, channel, _, message in messages if channel.topic == "/scene"]
    assert len(scenes[0].lines[0].points) == 2 * len(OFFICE.walls)
    assert sum(bool(entity.cylinders) for entity in scenes) == 5
    frames = {each.child_frame_id for _, channel, _, m in messages if channel.topic == "/tf" for each in m.transforms}
    assert frames == {"robot-1", "robot-1-believes", "robot-2", "robot-2-believes"}
    said = [message.message for _, channel, _, message in messages if channel.topic == "/log"]
    assert said.count("done") == 2
    assert {row["robot"] for row in learnt} == {1, 2}
    assert all(row == {"robot": row["robot"], "way": 0, "turn": 0, "curve_radpm": 0} for row in learnt[:2])
    last = {row["robot"]: row for row in learnt}
    assert json.loads(out)["drift"] == [last[1], last[2]]
    assert any(line.startswith("odometry error   way ") for line in said)
    assert isinstance(_command("inspection", "--profile", "paper", "--record", "no/where/x.mcap")[2], UsageError)
    _, out, error = _command("inspection", "--profile", "paper", "--record", "/dev/full", "--duration", "1", "--json")
    assert isinstance(error, Unavailable)
    assert json.loads(out)["robots"] == 2, "what robots did is not lost with the recording"


def test_the_models_of_noise_are_told_apart_on_the_command_line() -> None:
    for model in NoiseModel:
        assert OdometryNoise.parse(f"0.1,0.2,{model.value}") == OdometryNoise(0.1, 0.2, model)
    assert isinstance(_command("inspection", "--noise", "0.1;0.2")[2], UsageError)


@pytest.mark.parametrize(("noise", "is_told"), [("0.05,0.05,fixed", False), ("0.1,0.1", False), ("0.1,0.12", True)])
def test_wheels_that_are_worse_than_robots_allow_for_are_told(noise: str, is_told: bool) -> None:
    words = ["run", "office", "--profile", "paper", "--noise", noise, "--duration", "1"]
    said = CliRunner().invoke(group, words, standalone_mode=False).stderr
    assert ("their fixes can be false" in said) == is_told


def test_a_run_in_which_nothing_was_searched_prints_no_figures_of_it(tmp_path: Path) -> None:
    hall, mission = tmp_path / "hall.yaml", tmp_path / "open.yaml"
    hall.write_text("size: [10, 10]\nwalls: []\n")
    mission.write_text("mission: open\nnodes:\n  start: {start: true, final: true, see: {doorway: [5, 5]}}\n")
    code, out, error = _command(str(mission), "--world", str(hall), "--start", "3,1.5", "--duration", "1")
    assert error is None
    assert code == 1
    assert "search                -" in out
