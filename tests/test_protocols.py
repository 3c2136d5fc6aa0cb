"""The protocols beside flocking: what each promises, that it can be audited, and that its liars are stopped."""

from __future__ import annotations

import itertools
import math
import pickle
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.attacks import IN_PROTOCOLS
from phalanx.config import BtiConfig
from phalanx.errors import UsageError
from phalanx.lab.determinism.check import check_controller
from phalanx.lab.scorecard.flock_trial import stop_bound_s
from phalanx.robot.controllers.places import PLACES, PlaceController
from phalanx.robot.controllers.protocol import find_protocol
from phalanx.robot.controllers.protocols.warehouse import Floor
from phalanx.robot.controllers.sightings import SightController
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import PROTOCOLS, Scenario
from phalanx.wire import protocols, table
from phalanx.wire.record import MalformedRecord
from phalanx.world.scenarios.run import Run
from protocol_world import ProtocolWorld, task_of

ROBOTS = 5


def small(name: str, *attacks: AttackSpec, defence: str = "hardened", end_s: float = 13.0) -> Scenario:
    bti = BtiConfig(f_max=1)
    scenario = replace(find_scenario(name), robots=ROBOTS, bti=bti, n_max=8, defence=defence)
    return replace(scenario, attacks=attacks, duration_s=end_s)


def run_of(scenario: Scenario) -> Run:
    run = Run(scenario)
    run.advance(scenario.duration_s)
    return run


# --- all of them --------------------------------------------------------------------------------------------------


def test_a_first_byte_is_one_records_here_too():
    told = [*table.PAYLOADS, *protocols.RECORDS]
    tags = [record.tag for record in told if record.tag not in (None, table.KIND_AUDIT)]
    assert len(tags) == len(set(tags))


@pytest.mark.parametrize("name", PROTOCOLS)
def test_each_has_a_scenario_a_lie_and_a_measure(name):
    assert find_scenario(name).controller == name
    assert name in {attack.against for attack in IN_PROTOCOLS.values()}
    assert find_protocol(name).stage.counts


@pytest.mark.parametrize("name", PROTOCOLS)
def test_it_goes_on_from_each_checkpoint_with_the_same_bytes(name):
    straight, relayed = (ProtocolWorld(name, task_of(name, ROBOTS)) for _ in range(2))
    relayed.relayed = True
    for world in (straight, relayed):
        world.live(12.0)
    assert straight.said == relayed.said
    assert len(straight.said) > 12.0 / 0.25 * ROBOTS


@pytest.mark.parametrize("name", PROTOCOLS)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_whatever_a_frame_or_a_checkpoint_holds_nothing_raises_but_what_may(name, data):
    robot = ProtocolWorld(name, task_of(name, ROBOTS)).robots[2]
    heads = st.sampled_from(
        [robot.encode()[:1], b"\x01", *(bytes([each.tag]) for each in protocols.RECORDS if each.tag)]
    )
    longer = [table.SENSOR.size + protocols.SEEN.size - 1]
    sizes = st.sampled_from([26, *longer, *(record.size - 1 for record in (*protocols.RECORDS, table.STATE))])
    for _ in range(5):
        frame = data.draw(heads) + data.draw(sizes.flatmap(lambda n: st.binary(min_size=n, max_size=n)))
        robot.on_recv(2000, frame)
        told = robot.on_input(3, 2000, frame)
        assert len(told[0].payload) == table.ACCELERATION.size
    before = robot.encode()
    try:
        robot.decode(data.draw(st.binary(min_size=len(before), max_size=len(before))))
    except MalformedRecord:
        robot.decode(before)
    robot.on_input(4, 2250, table.SENSOR.form.pack(table.KIND_SENSOR, 2, 2250, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("lie", [name for name, each in IN_PROTOCOLS.items() if each.verdicts["hardened"] == "stopped"])
def test_its_liar_is_stopped_in_time_and_nobody_else(lie):
    run = run_of(small(IN_PROTOCOLS[lie].against, AttackSpec(name=lie, at_s=2.0, robot=2)))
    summary = run.summary()
    (told,) = summary["compromised"]
    assert told["first_deviation_s"] is not None
    bound_s = stop_bound_s(run.scenario, output_missing=True)
    assert told["safe_mode_s"] - told["first_deviation_s"] <= bound_s
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []
    assert run.world.fleet.robot["audits_passed"].sum() >= ROBOTS


@pytest.mark.parametrize("name, lie", [("patrol", "claim-visits"), ("exploration", "claim-area")])
def test_who_claims_a_place_a_turn_is_believed(name, lie):
    run = run_of(small(name, AttackSpec(name=lie, at_s=2.0, robot=2), defence="none", end_s=14.0))
    believed = [place for place, (_, rob_id) in enumerate(run.robots[0].controller.visits) if rob_id == 2]
    assert len(believed) >= 5
    told = (place for place, visits in enumerate(run.stage.visits) if any(rob_id == 2 for _, rob_id in visits))
    assert len(set(believed) - set(told)) >= 5, "it was there while it was honest"


@pytest.mark.parametrize("name, lie", [("patrol", "claim-visits"), ("tracking", "alter-entries")])
def test_what_one_audit_replayed_no_further_one_does_and_the_run_is_the_same(name, lie):
    scenario = small(name, AttackSpec(name=lie, at_s=4.0, robot=2), end_s=9.0)
    told, known = [], []
    for plain in (False, True):
        run = Run(scenario, plain=plain)
        run.advance(scenario.duration_s)
        told.append(run.summary() | {"real_time_factor": None})
        known.append(run.world.fleet.memo.passed["end"].tolist())
    assert told[0] == told[1]
    assert all(known[0][rob_id % ROBOTS] for rob_id in (1, 3, 4, 5)), "the last that passed, of each but the liar"
    assert not any(known[1])


@pytest.mark.parametrize("name", PROTOCOLS)
def test_a_stage_that_goes_on_forgets_what_was_and_counts_what_came_since(name):
    task = task_of(name, ROBOTS)
    kept, forgetful = (ProtocolWorld(name, task) for _ in range(2))
    for world in (kept, forgetful):
        world.live(60.0)
    forgetful.stage.forget(0.0)
    assert forgetful.stage.score(()) == kept.stage.score(())
    assert forgetful.stage.things(60.0) == kept.stage.things(60.0)
    forgetful.stage.forget(30.0)
    assert forgetful.stage.things(60.0) == kept.stage.things(60.0)
    assert 0 <= forgetful.stage.score(()) <= 100
    if name not in ("warehouse", "exploration"):
        forgetful.stage.forget(60.0)
        assert forgetful.stage.score(forgetful.ids) == forgetful.stage.score(()) == 0.0
        assert len(pickle.dumps(forgetful.stage)) < 0.8 * len(pickle.dumps(kept.stage))


def test_a_lie_is_of_one_protocol():
    with pytest.raises(UsageError, match="attack hog-cells has no effect on controller flock"):
        Scenario(attacks=(AttackSpec(name="hog-cells"),))


@pytest.mark.parametrize("name", ["gps-spoof", "alter-entries"])
def test_attacks_on_readings_take_those_that_see_more(name):
    run = run_of(small("tracking", AttackSpec(name=name, at_s=2.0, robot=2)))
    liar = run.robots[1]
    aside_m = (liar.me.x_m, liar.me.y_m) - run.positions_m[1]
    drawn_m = 5.0 * 11.0 if name == "gps-spoof" else 0.0  # 5 m/s along each axis
    assert aside_m.tolist() == pytest.approx([drawn_m, -drawn_m], abs=6.0)
    assert run.in_safe_mode.tolist() == [False, name != "gps-spoof", False, False, False]


@pytest.mark.parametrize("name, protocol", [("show-intruder", "perimeter"), ("show-target", "tracking")])
def test_who_is_shown_what_is_not_there_says_so_in_good_faith_and_nobody_is_stopped(name, protocol):
    run = run_of(small(protocol, AttackSpec(name=name, at_s=2.0, robot=2)))
    (told,) = run.summary()["compromised"]
    assert told["first_deviation_s"] is None
    assert not run.in_safe_mode.any()
    assert run.world.fleet.robot["audits_passed"].sum() >= ROBOTS
    x_m, y_m = run.positions_m[1]
    said = run.robots[0].controller.sighted[2]  # as another robot has heard
    assert abs(said.x_m - x_m - 2.0) < 5.0 and abs(said.y_m - y_m - 2.0) < 5.0


@pytest.mark.long
@pytest.mark.parametrize("name", PROTOCOLS)
def test_it_can_be_audited(name):
    assert check_controller(name).agrees


# --- the warehouse ------------------------------------------------------------------------------------------------


def test_a_way_is_as_cheap_as_any():
    floor = Floor(task_of("warehouse", 10))
    for goal in (floor.picks[3], floor.stations[-1]):
        dear = dict.fromkeys(range(30, 36), 7)
        least = {goal: 0}  # backwards, until nothing gets cheaper
        while True:
            cheaper = {
                cell: min(
                    (
                        cost + dear.get(beside, 0) + least[beside]
                        for beside, cost in floor.around(cell)
                        if beside in least
                    ),
                    default=math.inf,
                )
                for cell in range(floor.columns * floor.rows)
                if cell != goal and cell not in floor.shelves
            } | {goal: 0}
            if cheaper == least:
                break
            least = cheaper
        for start in floor.picks[::5]:
            way = floor.way(start, goal, dear)
            spent = sum(dict(floor.around(a))[b] + dear.get(b, 0) for a, b in itertools.pairwise([start, *way]))
            assert spent == least[start]
            assert not set(way) & floor.shelves


@settings(max_examples=50, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000))
def test_no_two_robots_are_in_one_cell_whatever_is_lost_but_four_times_running(seed):
    dice, lost_last = random.Random(seed), {}

    def lost(one: int, other: int, step: int) -> bool:
        so_far = lost_last.get((one, other), 0)
        lost_last[one, other] = so_far + 1 if so_far < 3 and dice.random() < 0.3 else 0
        return lost_last[one, other] > 0

    crossing = ((9.0, 6.0), (6.0, 9.0), (12.0, 9.0), (9.0, 12.0), (9.0, 3.0))  # cells around one of 3 m
    # All, or some of them, speak at the same moment.
    task = replace(task_of("warehouse", ROBOTS, seed), starts_m=crossing, state_every=1 + 2 * (seed % 2))
    floor, world = Floor(task), ProtocolWorld("warehouse", task, lost)
    for _ in world.steps(8.0):
        theirs = [cell for robot in world.robots.values() for cell in {robot.here, robot.holds} - {protocols.NOWHERE}]
        assert len(theirs) == len(set(theirs))
        for one, other in itertools.combinations(world.place_m.values(), 2):
            assert math.dist(one, other) > floor.cell_m / 2
    assert [robot.here for robot in world.robots.values()] != [floor.cell_at(start) for start in crossing]


def test_what_is_fetched_and_brought_is_counted_and_not_of_who_lies():
    task = task_of("warehouse", ROBOTS)
    world = ProtocolWorld("warehouse", task)
    world.live(90.0)
    legs = {rob_id: robot.done for rob_id, robot in world.robots.items()}
    assert world.stage.score(()) == pytest.approx(sum(each // 2 for each in legs.values()), abs=ROBOTS)
    assert world.stage.score(()) >= ROBOTS
    assert world.stage.score(world.ids) == 0.0
    floor, stage = Floor(task), find_protocol("warehouse").stage(task)
    for leg in range(4):
        stage.look(1, 0.0, floor.middle(floor.goal(1, leg)), lies=leg > 1)
    assert stage.score(()) == 1.0


# --- patrol, exploration ------------------------------------------------------------------------------------------


def test_no_place_is_missed_and_few_are_seen_twice():
    world = ProtocolWorld("exploration", task_of("exploration", ROBOTS))
    world.live(120.0)
    assert world.stage.score(()) == 100.0
    assert world.stage.score((1,)) < 100.0
    assert {world.robots[1].last_visit_ms(121_000, place) > 0 for place in PLACES} == {True}


TURN_MS = 1500


def explorer() -> PlaceController:
    return ProtocolWorld("exploration", task_of("exploration", ROBOTS)).make(1)


def says(robot: PlaceController, *words: tuple[int, int]) -> None:
    """In robot 2's name, at a time that it has come to a place."""
    for t_ms, here in words:
        nowhere = protocols.NOWHERE
        robot.on_recv(t_ms, protocols.CLAIM.encode(id=2, t=t_ms, here=here, holds=nowhere, wants=nowhere))


def test_who_falls_silent_is_doubted_in_what_it_said_shortly_before():
    robot = explorer()
    early_ms = 2 * TURN_MS
    late_ms = early_ms + -(-robot.task.doubt_ms // TURN_MS) * TURN_MS
    says(robot, *((t_ms, 7) for t_ms in range(early_ms, late_ms, TURN_MS)), (late_ms, 8), (late_ms + TURN_MS, 8))
    soon_ms, later_ms = late_ms + 2 * TURN_MS, late_ms + 10 * TURN_MS
    assert robot.last_visit_ms(soon_ms, 7) == early_ms
    assert robot.last_visit_ms(soon_ms, 8) == late_ms
    assert robot.last_visit_ms(later_ms, 7) == early_ms
    assert robot.last_visit_ms(later_ms, 8) == 0
    # Somebody else speaks in its name: a robot that was stopped never speaks again.
    says(robot, *((t_ms, 7) for t_ms in range(later_ms, later_ms + 20 * TURN_MS, TURN_MS)))
    assert robot.last_visit_ms(later_ms + 20 * TURN_MS, 7) > 0
    assert robot.last_visit_ms(later_ms + 20 * TURN_MS, 8) == 0


@pytest.mark.parametrize("after_ms", range(50, TURN_MS, 50))
def test_a_word_in_anothers_name_is_no_visit_once_its_owner_has_spoken(after_ms):
    robot = explorer()
    for turn in range(2, 12):
        says(robot, (turn * TURN_MS, 7), (turn * TURN_MS + after_ms, 10 + turn))
    says(robot, *((turn * TURN_MS, 7) for turn in range(12, 16)))
    assert robot.last_visit_ms(16 * TURN_MS, 7) > 0
    assert not any(robot.last_visit_ms(16 * TURN_MS, place) for place in PLACES if place != 7)


def test_a_patrol_watches_most_places_most_of_the_time():
    world = ProtocolWorld("patrol", task_of("patrol", 6))
    world.live(90.0)
    assert world.stage.score(()) > 70.0
    assert world.stage.score(world.ids) == 0.0
    assert all(visits for visits in world.stage.visits)


@pytest.mark.parametrize("name", ["patrol", "exploration"])
def test_of_two_who_go_to_one_place_one_goes_elsewhere(name):
    world = ProtocolWorld(name, task_of(name, 6))
    both = 0
    for _ in world.steps(30.0):
        held = [robot.holds for robot in world.robots.values() if robot.holds != protocols.NOWHERE]
        both += len(held) - len(set(held))
    assert both <= 6 * 6  # steps, from when they choose to when they hear of it


# --- perimeter, tracking ------------------------------------------------------------------------------------------


def tracker(rob_id: int, *things: tuple[int, int, float, float]) -> SightController:
    """A robot that was told by others of things: id, time ms, and where the one thing is."""
    robot = ProtocolWorld("tracking", task_of("tracking", 9)).make(rob_id)
    for other, t_ms, x_m, y_m in things:
        robot.on_recv(t_ms, protocols.SIGHTING.encode(id=other, t=t_ms, number=0, x_m=x_m, y_m=y_m))
    return robot


def drive(
    robot: SightController, t_ms: int, seen: tuple[int, float, float] = (protocols.NOWHERE, 0.0, 0.0)
) -> list[bytes]:
    """What it puts out at its post, when it is its turn."""
    at_m = robot.task.starts_m[robot.rob_id - 1]
    reading = table.SENSOR.form.pack(table.KIND_SENSOR, robot.rob_id, t_ms, *at_m, 0.0, 0.0)
    told = robot.on_input(robot.task.state_every - robot.rob_id, t_ms, reading + protocols.SEEN.form.pack(*seen))
    return [each.payload for each in told]


def test_the_latest_word_counts_of_two_the_own_and_none_for_long():
    robot = tracker(1, (2, 5000, 1.0, 2.0), (3, 5500, 3.0, 4.0), (40, 5600, 5.0, 6.0))
    drive(robot, 5600)
    assert robot.things() == {0: (3.0, 4.0)}
    frame = drive(robot, 5800, (0, 7.0, 8.0))[-1]
    assert protocols.SIGHTING.decode(frame) == {"id": 1, "t": 5800, "number": 0, "x_m": 7.0, "y_m": 8.0}
    robot.on_recv(5800, protocols.SIGHTING.encode(id=9, t=5800, number=0, x_m=0.0, y_m=0.0))
    assert robot.things() == {0: (7.0, 8.0)}
    drive(robot, 5800 + 2 * robot.period_ms)
    assert robot.things() == {0: (7.0, 8.0)}
    drive(robot, 5801 + 2 * robot.period_ms)
    assert robot.things() == {}
    assert robot.target_point() == robot.task.starts_m[0]


def test_of_each_robot_one_word_is_known():
    robot = tracker(1)
    for number in range(30):
        robot.on_recv(5000, protocols.SIGHTING.encode(id=2, t=5000, number=number, x_m=9.0, y_m=9.0))
    drive(robot, 5000)
    assert list(robot.things()) == [29]


def test_the_nearest_go_there_and_nobody_else():
    goes = []
    for rob_id in range(1, 10):
        robot = tracker(rob_id, (9 if rob_id == 1 else 1, 5000, -1.0, -2.0))
        robot.on_input(0, 5000, b"")  # makes no sense: nobody drives
        for other in robot.others.values():
            other.heard_ms = 5000
        drive(robot, 5000)
        goes += [rob_id] if robot.holds == 0 else []
    assert goes == [1, 2, 4, 5]  # of a grid of three by three, around its first corner


def test_two_catch_an_intruder_at_once_who_do_not_lie():
    stage = find_protocol("perimeter").stage(task_of("perimeter", 12))
    at_m = stage.things(6.0)[0]
    stage.look(1, 6.0, at_m, lies=False)
    stage.look(1, 6.1, at_m, lies=False)
    stage.look(2, 6.2, at_m, lies=True)
    stage.look(3, 6.7, at_m, lies=False)
    assert list(stage.things(6.7)) == [0]
    x_m, y_m = stage.things(6.8)[0]
    assert protocols.SEEN.form.unpack(stage.look(2, 6.8, (x_m + 3.0, y_m), lies=False)) == (0, -3.0, 0.0)
    assert list(stage.things(6.8)) == []
    last_s = 29.0  # the first of all has had the time to get through by then
    assert protocols.SEEN.form.unpack(stage.look(1, last_s, (500.0, 0.0), lies=False))[0] == protocols.NOWHERE
    assert stage.score(()) == stage.score((2,)) == 100.0
    assert stage.score((2, 3)) == 0.0


def lied_to(name: str, robots: int, liar: int) -> tuple[float, float]:
    """What comes of it in 60 s, and what with one who says that all is where the robot farthest from it is."""
    scores = []
    for lies in (False, True):
        world = ProtocolWorld(name, task_of(name, robots))
        for _ in world.steps(60.0):
            seen = [said for each in world.robots.values() if (said := each.sighted[each.rob_id]).at_ms]
            last = max(seen, key=lambda said: said.at_ms, default=None)
            if lies and last:
                far = max(world.place_m.values(), key=lambda at_m: math.dist(at_m, (last.x_m, last.y_m)))
                said = {"id": liar, "t": 0, "number": last.number, "x_m": far[0], "y_m": far[1]}
                for rob_id, robot in world.robots.items():
                    if rob_id != liar:
                        robot.on_recv(last.at_ms + 2, protocols.SIGHTING.encode(**said))
        scores.append(world.stage.score((liar,) if lies else ()))
    return scores[0], scores[1]


@pytest.mark.parametrize(("name", "robots", "least"), [("perimeter", 12, 90.0), ("tracking", 9, 60.0)])
def test_together_they_do_it_and_a_lie_undoes_it(name, robots, least):
    honest, attacked = lied_to(name, robots, liar=3)
    assert honest > least
    assert attacked < honest - find_protocol(name).stage.bites_from
