"""What triggers a node beside landmarks: beacons, quantities above a level, and what another robot is seen to do."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from phalanx.cli.mission.files import read_plain
from phalanx.errors import PeerError, UsageError
from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Landmark,
    Position,
    Profile,
    Sensor,
    Walker,
    build,
    plain_mission,
)
from phalanx.mission.file.canonical import action_bytes
from phalanx.mission.landmarks import FloorPlan, WallCode, floorplan_of_yaml
from phalanx.mission.landmarks.floorplan import Beacon, Quantity, sources_of
from phalanx.mission.walk.claims import Unshown
from phalanx.robot.controllers.mission.controller import Assignment, MissionController, Missions
from phalanx.robot.controllers.mission.evidence import (
    BadEvidence,
    code_entry,
    pack_evidence,
    parse_sensed,
    reading_entry,
    unpack_evidence,
)
from phalanx.robot.controllers.mission.readings import SENSED_MAX_BYTES, Sensors
from phalanx.wire.table import ACTION, KIND_ACTION
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions import world as missions_world
from phalanx.world.missions.body import SHOWN_S, Building, MissionBody
from phalanx.world.missions.orders import BEACON_M, Orders, orders_of
from phalanx.world.missions.report import summary
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.world import MissionWorld

LEAK = read_plain(str(Path(__file__).parents[1] / "examples" / "leak.yaml"))
WORKS = load_floorplan(LEAK.floor_plan)
SENSORS = Sensors()
HALL = floorplan_of_yaml(b"size: [10, 10]\nwalls: [[5, 0, 5, 10], [0, 0, 0, 10]]\n")
BOTH = pytest.mark.parametrize("profile", [Profile.PAPER, Profile.SEALED])


@cache
def leak(profile: Profile) -> Orders:
    return orders_of(LEAK, build(LEAK, BuildOptions(profile=profile), random.Random(0).randbytes), WORKS)


@BOTH
def test_two_robots_find_a_leak_by_what_they_sense_and_see_each_other_do(profile: Profile) -> None:
    run = leak(profile).run(seed=1, duration_s=90.0)
    assert not run.alone
    reports = run_mission(run)
    told = summary(run, reports)
    assert (told["completed"], told["decoded"], told["false_decodes"]) == (2, 8, 0)
    assert [(row["robot"], row["action"]) for row in told["actions"]] == [(1, "lamp"), (2, "shut")]
    when = {(report.robot, node): t_s for report in reports for t_s, node in report.decoded}
    assert when[0, 2] < when[1, 2] < when[1, 3] < when[0, 3], "gas, its lamp, the valve, the other's hand on it"


def test_robots_that_audit_each_other_show_what_their_other_sensors_read() -> None:
    run = leak(Profile.PAPER).run(robots=4, defence="hardened", duration_s=60.0)
    told = summary(run, run_mission(run))
    assert (told["completed"], told["in_safe_mode"], told["audits"]["refused"]) == (4, [], 0)


@pytest.mark.parametrize("missing", ["sight", "message"])
def test_neither_the_sight_of_another_robot_nor_its_message_is_enough(missing: str, monkeypatch) -> None:
    if missing == "sight":
        monkeypatch.setattr(missions_world, "WATCH_M", 0.1)
    else:
        monkeypatch.setattr(missions_world.pybot, "perform", lambda *_: None)
    a, b = run_mission(leak(Profile.PAPER).run(duration_s=45.0))
    assert [node for _, node in a.decoded] == [0, 1, 2]
    assert [node for _, node in b.decoded] == [0, 1]


def test_what_a_robot_does_is_seen_for_a_while_from_near_and_not_through_walls() -> None:
    world = MissionWorld(leak(Profile.PAPER).run())
    a, b = world.robots
    a.body.wheels.pose, b.body.wheels.pose = (12.0, 5.0, 0.0), (9.0, 5.0, 3.0)
    assert world._watched(b) == []
    a.body.actions.clear()
    a.body.execute_command(_action("lamp"))
    assert world._watched(b) == ["a does lamp"]
    assert world._watched(a) == []
    b.body.wheels.pose = (6.0, 9.0, 0.0)
    assert world._watched(b) == [], "behind a wall"
    b.body.wheels.pose = (1.0, 5.0, 0.0)
    assert world._watched(b) == [], "too far"
    b.body.wheels.pose = (9.0, 5.0, 0.0)
    a.body.advance(SHOWN_S + 0.1)
    assert world._watched(b) == [], "long ago"
    a.body.execute_command(_action("lamp")[:-1])
    assert world._watched(b) == [], "what is no action"


def _action(name: str) -> bytes:
    return ACTION.form.pack(KIND_ACTION, 1, 0) + action_bytes(Action(name))


def read_at(plan: FloorPlan, x_m: float, times: int = 200) -> float:
    """The share of readings at a place in which anything is read."""
    body = MissionBody(1, Building(plan), SENSORS, (x_m, 5.0, 0.0), OdometryNoise(), (0, 1))
    return sum(bool(body._near()) for _ in range(times)) / times


def test_beacons_are_heard_through_walls_quantities_are_kept_by_them_and_noise_blurs_both() -> None:
    uwb = Beacon(reading="uwb", x_m=4.0, y_m=5.0, range_m=2.0, noise_m=0.1)
    gas = Quantity(reading="gas", x_m=4.0, y_m=5.0, peak=100, half_m=1.0, over=50, noise=5)
    heard, smelt = replace(HALL, sources=(uwb,)), replace(HALL, sources=(gas,))
    assert [read_at(heard, x) for x in (2.5, 5.5, 1.5)] == [1.0, 1.0, 0.0]
    assert [read_at(smelt, x) for x in (3.5, 5.2, 1.5)] == [1.0, 0.0, 0.0]
    for plan, at in ((heard, 2.0), (smelt, 3.0)):
        assert 0.4 < read_at(plan, at) < 0.6, "at the very edge it is one reading in two"
    both = replace(HALL, sources=(replace(uwb, x_m=3.5), gas))
    body = MissionBody(1, Building(both), SENSORS, (4.0, 5.0, 0.0), OdometryNoise(), (0, 1))
    assert body._near() == ["gas", "uwb"], "the nearest first"


def test_a_building_with_sources_gives_the_same_run_to_who_does_not_need_them() -> None:
    body, other = (
        MissionBody(1, Building(plan), SENSORS, (4.0, 5.0, 0.0), OdometryNoise(), (0, 1))
        for plan in (HALL, replace(HALL, sources=(Beacon(reading="b"),)))
    )
    for k in range(5):
        assert body.sense(k)[1] == other.sense(k)[1][: 2 * SENSORS.lidar.beams]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"beacons": 7}, "beacons is not a list"),
        ({"beacons": [{"id": "x"}]}, "beacons, number 1, is"),
        ({"beacons": [{"id": "x", "at": [1, 2, 3]}]}, "beacons, number 1, is"),
        ({"beacons": [{"id": "", "at": [1, 2]}]}, "beacons, number 1, is"),
        ({"beacons": [{"id": "x", "at": [1, 2], "colour": 3}]}, "beacons, number 1, is"),
        ({"beacons": [{"id": "x", "at": [1, 2], "range": -3}]}, "range_m is -3"),
        ({"beacons": [{"id": "x", "at": [1, "b"]}]}, "y_m is 'b'"),
        ({"beacons": [{"id": "x", "at": [1, 2], "noise": float("nan")}]}, "noise_m is nan"),
        ({"quantities": [{"reading": "x", "at": [1, 2], "peak": 3, "over": 4}]}, "over is 4, peak is 3"),
        ({"quantities": [{"reading": "x" * 65, "at": [1, 2]}]}, "quantities, number 1, is"),
    ],
)
def test_a_source_that_is_none_is_refused_with_its_place(words: dict, said: str) -> None:
    with pytest.raises(UsageError) as refused:
        sources_of(words, "map.yaml")
    assert str(refused.value).startswith("map.yaml: ")
    assert said in str(refused.value)


def test_a_map_of_either_kind_has_sources(tmp_path: Path) -> None:
    words = "beacons: [{id: b, at: [1, 2], range: 4.5}]\n"
    (tmp_path / "ours.yaml").write_text("size: [10, 10]\nwalls: []\n" + words)
    (tmp_path / "ros.pgm").write_bytes(b"P5 4 4 255\n" + bytes([254] * 16))
    (tmp_path / "ros.yaml").write_text(
        "image: ros.pgm\nresolution: 1.0\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
        + words
    )
    for name in ("ours", "ros"):
        assert load_floorplan(tmp_path / f"{name}.yaml").sources == (Beacon(reading="b", x_m=1, y_m=2, range_m=4.5),)


def node_that_sees(reading: str, **more) -> dict:
    nodes = {
        "start": {"start": True, "see": {"position": [2, 2]}},
        "end": {"see": {"sensor": reading, **more}, "do": "lamp"},
    }
    return {"mission": "one", "nodes": nodes, "ways": [["start", "end"]]}


def test_a_beacon_stands_where_a_mission_wants_its_reading_and_the_map_shows_none() -> None:
    def put(reading: str, plan: FloorPlan = HALL) -> tuple:
        plain = plain_mission(node_that_sees(reading, position=[3, 3]))
        built = build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)
        orders = orders_of(plain, built, plan)
        assert [part.name for part in orders.parts] == (["robot"] if " does " in reading else [""])
        return orders.plan.sources

    known = Beacon(reading="dock")
    assert put("dock") == (Beacon(reading="dock", x_m=3, y_m=3, range_m=BEACON_M),)
    assert put("dock", replace(HALL, sources=(known,))) == (known,)
    assert put("robot does lamp") == ()


@pytest.mark.parametrize(
    ("reading", "more", "said"),
    [
        ("gas", {}, "add a position in see"),
        ("robot does lmap", {"position": [3, 3]}, "did you mean robot does lamp?"),
        ("robot does nothing", {"position": [3, 3]}, "use robot does lamp"),
    ],
)
def test_a_reading_that_nothing_here_gives_is_refused(reading: str, more: dict, said: str) -> None:
    plain = plain_mission(node_that_sees(reading, **more))
    built = build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)
    with pytest.raises(
        UsageError, match=f"'end' requires the reading '{reading}', which has no source in map"
    ) as refused:
        orders_of(plain, built, HALL)
    assert said in refused.value.hint


def test_what_stands_behind_a_scan_is_what_was_read_and_no_more_than_there_is_room_for() -> None:
    scan = Building(HALL).lidar.sweep((2.0, 5.0, 0.0), np.random.default_rng(0))
    bare, beams = SENSORS.raw_of(scan), SENSORS.lidar.beams
    many = [f"reading-{k}".encode() for k in range(90)]
    raw = SENSORS.raw_of(scan, map(reading_entry, many))
    kept, codes = parse_sensed(raw[SENSORS.scan_bytes :])
    assert codes == ()
    assert raw[: 2 * beams] == bare
    assert len(raw) - len(bare) <= SENSED_MAX_BYTES
    assert kept == tuple(many[: len(kept)])
    assert 60 < len(kept) < 90
    assert unpack_evidence(pack_evidence(None, bare, raw[2 * beams :]), beams) == (None, raw)
    entry = reading_entry(b"a")
    for wrong in (
        b"\0",
        entry[:-1],
        entry + b"\0",
        reading_entry(b""),
        b"\2" + entry[1:],
        b"\1" + entry[1:],
        entry * 300,
    ):
        with pytest.raises(PeerError):
            parse_sensed(wrong)
        with pytest.raises(BadEvidence):
            unpack_evidence(pack_evidence(None, bare, wrong), beams)


@BOTH
def test_a_robot_cannot_show_a_reading_that_its_s_node_did_not_chain(profile: Profile) -> None:
    draft = Draft("smell")
    draft.node("start", Position(2.0, 5.0), start=True)
    draft.node("gas", (Position(2.0, 5.0), Sensor(b"gas")), final=True)
    draft.way("start", "gas")
    (one,) = build(draft.mission(), BuildOptions(profile=profile), random.Random(0).randbytes)
    missions = Missions({1: Assignment(one.mission, (2.0, 5.0, 0.0))}, SENSORS)
    own = MissionController(1, missions, Walker(one.mission, one.key))
    peer = MissionController(1, missions, Walker(one.mission, replays=True))
    bare = SENSORS.raw_of(Building(HALL).lidar.sweep((2.0, 5.0, 0.0), np.random.default_rng(0)))
    tails = {name: reading_entry(name) for name in (b"gas", b"smoke")} | {b"": b""}

    def reading_of(step: int, sensed: bytes) -> tuple[int, int, bytes]:
        raw = bare + tails[sensed]
        return step, 1000 + 250 * step, SENSORS.make(1, 1000 + 250 * step, (0.0, 0.0, 0.0), 0.0, raw)

    evidence = own.keep(*reading_of(0, b""), bare)
    own.on_evidence(*reading_of(0, b""), evidence)
    peer.on_evidence(*reading_of(0, b""), evidence)
    assert own.keep(*reading_of(1, b"smoke"), bare + tails[b"smoke"]) == b""
    evidence = own.keep(*reading_of(1, b"gas"), bare + tails[b"gas"])
    claim, _ = unpack_evidence(evidence, SENSORS.lidar.beams)
    before = peer.encode()
    for chained, shown, refusal in (
        (b"", tails[b"gas"], BadEvidence),
        (b"smoke", tails[b"gas"], BadEvidence),
        (b"gas", b"", BadEvidence),
        (b"", b"", Unshown),
        (b"smoke", tails[b"smoke"], Unshown),
    ):
        with pytest.raises(refusal):
            peer.on_evidence(*reading_of(1, chained), pack_evidence(claim, bare, shown))
        peer.decode(before)
    assert peer.on_evidence(*reading_of(1, b"gas"), evidence) == own.on_evidence(*reading_of(1, b"gas"), evidence)
    assert set(peer.memory.walk.opened) == {0, 1}


def test_a_code_is_where_its_corners_say_and_they_are_in_the_hash() -> None:
    token = "7d1f0c52a9e84b3666c0e2f1b8d49a07"
    plan = replace(HALL, codes=(WallCode(token, 4.99, 5.0, 0.3, math.pi),))
    building = Building(plan)
    draft = Draft("code")
    draft.node("start", Position(3.5, 5.0), start=True)
    draft.node("code", Landmark("qr", 4.99, 5.0, math.pi, text=token), final=True)
    draft.way("start", "code")
    (one,) = build(draft.mission(), BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)
    missions = Missions({1: Assignment(one.mission, (3.5, 5.0, 0.0))}, SENSORS, eye=building.eye)
    own = MissionController(1, missions, Walker(one.mission, one.key))
    peer = MissionController(1, missions, Walker(one.mission, replays=True))
    body = MissionBody(1, building, SENSORS, (3.5, 5.0, 0.0), OdometryNoise(), (0, 1), picture_every=2)
    for step in range(2):
        t_ms = 1000 + 250 * step
        reading, raw = body.sense(t_ms)
        codes = parse_sensed(raw[SENSORS.scan_bytes :]).codes
        assert [code.text for code in codes] == [token] * step, "a picture at every other reading"
        evidence = own.keep(step, t_ms, reading, raw)
        claim, shown = unpack_evidence(evidence, SENSORS.lidar.beams)
        assert claim is not None
        assert shown == (raw if step else b"")
        if codes:
            bare, before = raw[: SENSORS.scan_bytes], peer.encode()
            moved = b"".join(code_entry(replace(code, corners_px=code.corners_px + 500.0)) for code in codes)
            for other in (b"", moved):
                with pytest.raises(BadEvidence):
                    peer.on_evidence(step, t_ms, reading, pack_evidence(claim, bare, other))
                chained = SENSORS.make(1, t_ms, (0.0, 0.0, 0.0), 0.0, bare + other)
                with pytest.raises(Unshown):
                    peer.on_evidence(step, t_ms, chained, pack_evidence(claim, bare, other))
                peer.decode(before)
        peer.on_evidence(step, t_ms, reading, evidence)
        own.on_evidence(step, t_ms, reading, evidence)
    assert set(peer.memory.walk.opened) == {0, 1}
    assert peer.encode() == own.encode()
