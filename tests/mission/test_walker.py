"""Walking: every modality of the paper, and which fixes are believed."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Experience,
    Kind,
    Landmark,
    Phase,
    Position,
    Profile,
    Reason,
    Sensor,
    State,
    Time,
    Walker,
    build,
)
from phalanx.mission.walk.fix import ALONE_SIGMAS, doubt_m
from worlds import (
    BOTH,
    CONFIG,
    at,
    at_start,
    built,
    cheap,
    corridor,
    decoded_of,
    draws,
    explored,
    fork,
    leading_to,
    truths,
    until_decoded,
    walk,
    walker_for,
    walker_of,
)

both = pytest.mark.parametrize("profile", BOTH)
DOOR = Landmark("doorway", 8.0, 1.0, 0.2)


@both
def test_a_chain_decodes_node_by_node_and_tells_what_to_do(profile):
    mission = cheap(corridor(5), profile)
    outcomes = [o for _, o in walk(mission, walker_of(built(mission, profile))) if o.decoded]
    assert [o.decoded.node for o in outcomes] == [0, 1, 2, 3, 4]
    assert [o.decoded.do for o in outcomes] == [node.do for node in mission.nodes]
    assert [o.order.kind for o in outcomes] == [Kind.GO] * 4 + [Kind.DONE]
    for outcome in outcomes[:-1]:
        source, target = mission.nodes[outcome.decoded.node].place, mission.nodes[outcome.decoded.node + 1].place
        true = math.atan2(target[1] - source[1], target[0] - source[0])
        assert outcome.order.direction_rad == pytest.approx(true, abs=math.pi / 120)
    assert [o.decoded.name for o in outcomes] == (["n0", "n1", "n2", "n3", "n4"] if profile else [""] * 5)


@both
def test_a_robot_that_only_saw_the_last_door_decodes_nothing(profile):
    mission = cheap(corridor(5), profile)
    walker = walker_of(built(mission, profile))
    steps = list(walk(mission, walker, places=[mission.nodes[-1].place, mission.nodes[2].place], steps_each=20))
    assert not [o for _, o in steps if o.decoded]
    assert {o.order.kind for _, o in steps} == {Kind.WAIT}


def spread_of(metres: float, radians: float) -> tuple[float, ...]:
    """Of a pose so unsure."""
    return metres**2, 0.0, 0.0, metres**2, 0.0, radians**2


def _put(fix, seen: Experience, landmark: Landmark) -> tuple[float, float]:
    """Where a landmark of a scan lies, had the robot been where the fix says."""
    sine, cosine = math.sin(fix.heading_rad - seen.heading_rad), math.cos(fix.heading_rad - seen.heading_rad)
    dx, dy = landmark.x_m - seen.x_m, landmark.y_m - seen.y_m
    return fix.x_m + cosine * dx - sine * dy, fix.y_m + sine * dx + cosine * dy


@both
def test_a_fix_mends_drift_as_far_as_the_robot_is_unsure_and_trials_tell_how_much(profile):
    draft = leading_to(DOOR)
    trials = []
    for drift in (0.0, 0.15, 0.29):
        walker, state = at_start(draft, profile, replace(CONFIG, kdf_tries=1000))
        turn = -0.1
        seen = Experience(
            1.0,
            6 + drift,
            0 - drift,
            turn,
            5.0,
            (Landmark("doorway", 8 + drift, 1 - drift, 0.2 + turn),),
            spread=spread_of(0.3, 0.2),
        )
        state, outcome = until_decoded(walker, state, seen)
        assert outcome.decoded.node == 1
        # Who knows nearly nothing is where the landmark says, as exactly as landmarks are seen.
        assert outcome.fix.heading_rad == pytest.approx(0.0, abs=0.02)
        assert _put(outcome.fix, seen, seen.landmarks[0]) == (pytest.approx(8, abs=0.03), pytest.approx(1, abs=0.03))
        assert outcome.fix.moved_m == pytest.approx(math.hypot(outcome.fix.x_m - seen.x_m, outcome.fix.y_m - seen.y_m))
        trials.append(outcome.trials)
    assert trials == sorted(trials)
    # In the sealed profile the likeliest is tried first, wherever it lies.
    assert trials[0] < trials[-1] or profile is Profile.SEALED


@both
def test_a_fix_moves_a_robot_the_less_the_surer_it_is(profile):
    walker, begun = at_start(leading_to(DOOR), profile)
    moves = []
    for metres in (0.04, 0.08, 0.2, 0.4):
        seen = Experience(1, 6, 0, 0, 5, (replace(DOOR, x_m=8.1, orientation_rad=0.2),), spread=spread_of(metres, 0.01))
        _, outcome = until_decoded(walker, begun, seen)
        moves.append(outcome.fix.moved_m)
    assert moves == sorted(moves)
    assert moves[0] < 0.04
    assert moves[-1] > 0.09


def test_a_fix_that_other_landmarks_contradict_is_refused():
    # Two doors are known; a third is seen where only a shift that the two contradict would put it.
    draft = Draft("contradiction")
    draft.node("start", Position(0, 0), start=True)
    doors = [Landmark("doorway", 3, 2, 0.0), Landmark("doorway", 5, -2, 0.3), Landmark("doorway", 6.5, 1, 0.6)]
    names = ["start"]
    for i, door in enumerate(doors):
        draft.node(f"d{i}", door)
        draft.way(names[-1], f"d{i}")
        names.append(f"d{i}")
    walker, state = at_start(draft, Profile.PAPER)
    for i in (0, 1):
        state, outcome = walker.step(state, Experience(1.0 + i, 2, 0, 0, 2.0, tuple(doors[: i + 1])))
        assert outcome.decoded.node == i + 1
    moved = replace(doors[2], x_m=6.85)
    _, outcome = walker.step(state, Experience(3.0, 2, 0, 0, 5.0, (doors[0], doors[1], moved)))
    assert outcome.decoded is None
    assert outcome.reason is Reason.CONTRADICTED
    _, outcome = walker.step(state, Experience(3.0, 2, 0, 0, 5.0, tuple(doors)))
    assert outcome.decoded.node == 3


@both
def test_a_pose_said_to_be_sure_is_not_believed_to_be_four_deviations_off(profile):
    walker, begun = at_start(leading_to(DOOR), profile)
    sure = Experience(1.0, 6, 0, 0, 5.0, spread=spread_of(0.04, 0.01))
    one = doubt_m(walker.config, sure, DOOR)
    for deviations, well in ((2.0, True), (4.2, False)):
        # To both sides at once; each alone is within the region of the search.
        off = deviations * one / math.sqrt(2)
        seen = replace(sure, landmarks=(replace(DOOR, x_m=8 + off, y_m=1 + off),))
        _, outcome = until_decoded(walker, begun, seen)
        assert (outcome.decoded is not None) is well, deviations
    _, outcome = walker.step(begun, seen)
    # In the sealed profile what cannot be is not even tried.
    assert outcome.reason is (Reason.DRIFT if profile is Profile.PAPER else Reason.NO_MATCH)
    _, outcome = until_decoded(walker, begun, replace(seen, spread=spread_of(0.2, 0.05)))
    assert outcome.decoded, "who says that it is unsure is believed"


@both
def test_who_is_at_a_place_is_there_however_its_doubt_has_it(profile):
    walker, begun = at_start(leading_to(Position(4, 0)), profile)
    for off_m in (0.05, 0.2):
        sure = (walker.config.place_m - off_m) / ALONE_SIGMAS
        for metres, well in ((0.95 * sure, True), (1.05 * sure, False)):
            seen = Experience(1.0, 4 + off_m, 0, 0, 4.0, spread=spread_of(metres, 0.02))
            _, outcome = until_decoded(walker, begun, seen)
            assert (outcome.decoded is not None) is well, (off_m, metres)
    # In the sealed profile what would not be believed is not even tried.
    wanted = Reason.AMBIGUOUS if profile is Profile.PAPER else Reason.NOTHING_SENSED
    assert walker.step(begun, replace(seen, x_m=4.2, spread=spread_of(0.15, 0.02)))[1].reason is wanted


@both
def test_what_is_too_far_off_is_not_decoded(profile):
    """A degree of heading makes of it what may be the next one."""
    walker, begun = at_start(leading_to(DOOR), profile)
    for away_m, well in ((walker.config.decode_m + 0.1, False), (walker.config.decode_m - 0.1, True)):
        seen = Experience(1.0, DOOR.x_m - away_m, DOOR.y_m, 0, 5.0, (DOOR,), spread=spread_of(0.05, 0.01))
        _, outcome = until_decoded(walker, begun, seen)
        assert (outcome.decoded is not None) is well, away_m


@both
def test_a_heading_that_cannot_be_is_refused_like_a_place(profile):
    walker, begun = at_start(leading_to(DOOR), profile)
    for degrees, well in ((5.0, True), (12.0, False)):
        seen = replace(DOOR, orientation_rad=0.2 + math.radians(degrees))
        experience = Experience(1.0, 6, 0, 0, 5.0, (seen,), spread=spread_of(0.2, math.radians(0.7)))
        _, outcome = until_decoded(walker, begun, experience)
        assert (outcome.decoded is not None) is well, degrees


def test_what_is_known_and_in_sight_has_its_say_in_a_fix():
    """A corner far off tells little of a heading without its orientation; with another to the side it tells all."""
    turn = math.radians(4.0)
    corners = [Landmark("concave_left", 5, 3), Landmark("concave_right", 2, -3)]

    def seen_by(t_s: float, robot_turn: float, *landmarks: Landmark) -> Experience:
        cosine, sine = math.cos(-robot_turn), math.sin(-robot_turn)
        turned = [replace(m, x_m=cosine * m.x_m - sine * m.y_m, y_m=sine * m.x_m + cosine * m.y_m) for m in landmarks]
        return Experience(t_s, 0, 0, -robot_turn, t_s, tuple(turned), spread=spread_of(0.15, math.radians(3)))

    draft = Draft("turn")
    draft.node("start", Position(0, 0), start=True)
    for i, corner in enumerate(corners):
        draft.node(f"c{i}", corner)
        draft.way("start", f"c{i}", both=True)
    walker, begun = at_start(draft, Profile.PAPER)
    _, alone = walker.step(begun, seen_by(5.0, turn, corners[0]))
    first, _ = walker.step(begun, seen_by(4.0, 0.0, corners[1]))
    _, both = walker.step(first, seen_by(5.0, turn, *corners))
    assert alone.decoded.node == both.decoded.node == 1
    assert (len(alone.fix.sightings), len(both.fix.sightings)) == (1, 2)
    assert abs(both.fix.heading_rad) < 0.6 * abs(alone.fix.heading_rad) < 0.6 * turn


def test_one_end_of_a_face_is_not_taken_for_the_other():
    """A pillar's two ends, 0.5 m apart with one normal: a robot 0.5 m off sees the one where it expects the other."""
    left, right = Landmark("concave_left", 5, 0.25, math.pi), Landmark("concave_right", 5, -0.25, math.pi)
    walker, begun = at_start(leading_to(left), Profile.PAPER)

    def looked(kind: str):
        seen = replace(right, type=kind, y_m=right.y_m + 0.5)
        return walker.step(begun, Experience(1.0, 2, 0.5, 0, 5.0, (seen,), spread=spread_of(0.2, 0.02)))[1]

    assert (looked("concave_right").decoded, looked("concave_right").reason) == (None, Reason.NO_MATCH)
    assert looked("concave_left").decoded, "without hands it would have been a false fix"


@both
def test_time_is_part_of_what_is_experienced(profile):
    draft = leading_to((DOOR, Time(1000.0)))
    walker = walker_for(draft, profile, replace(CONFIG, timeout_s=1000))
    begun, _ = walker.step(State(), Experience(900, 0, 0, 0))
    for t_s, well in ((930, False), (985, False), (995, True), (1005, True), (1015, True), (1025, False)):
        _, outcome = until_decoded(walker, begun, Experience(t_s, 6, 0, 0, 6.0, (DOOR,)), 6)
        assert (outcome.decoded is not None) is well, t_s


@both
def test_a_reading_and_a_place_must_come_together(profile):
    walker, begun = at_start(leading_to((Position(5, 0), Sensor(b"red"), Sensor(b"warm"))), profile)
    for x, sensors, well in (
        (5, (b"red", b"warm"), True),
        (5, (b"cold", b"warm", b"blue", b"red"), True),
        (5, (b"red",), False),
        (5, (b"red", b"red"), False),
        (9, (b"red", b"warm"), False),
    ):
        _, outcome = until_decoded(walker, begun, Experience(1, x, 0, 0, 5.0, sensors=sensors), 6)
        assert (outcome.decoded is not None) is well, (x, sensors)


@both
def test_an_event_of_the_controller_triggers_and_a_stale_one_does_not(profile):
    draft = leading_to(wait=("launch",), do=Action("launch"))
    one = built(cheap(draft.mission(), profile), profile)
    yesterday = built(cheap(draft.mission(), profile), profile, seed="yesterday")
    walker = walker_of(one)
    begun, outcome = walker.step(State(), Experience(0, 0, 0, 0))
    assert outcome.order.kind is Kind.WAIT
    pool = (Action("launch"),)
    stale = Experience(1, 0, 0, 0, messages=(yesterday.key.messages["launch"], b"launch"), actions=pool)
    state, outcome = walker.step(begun, stale)
    assert outcome.decoded is None
    _, outcome = walker.step(state, replace(stale, t_s=2, messages=(one.key.messages["launch"],)))
    assert outcome.decoded.do == Action("launch")


@both
def test_two_robots_hold_half_each_and_neither_goes_on_without_the_other(profile):
    # Fig. 5: a decodes its door and sends; only that message opens b's door, and b's answer opens a's last.
    draft = Draft("two")
    for part, y in (("a", 0.0), ("b", 50.0)):
        draft.node(f"{part}0", Position(0, y), start=True, part=part)
        draft.node(
            f"{part}2", Landmark("doorway", 9, y, 0.5), final=True, part=part, wait=("ba",) if part == "a" else ()
        )
    draft.node("a1", Landmark("doorway", 5, 0, 0.1), part="a", send=("ab",))
    draft.node("b1", Landmark("doorway", 5, 50, 0.1), part="b", send=("ba",), wait=("ab",))
    for part in "ab":
        draft.way(f"{part}0", f"{part}1")
        draft.way(f"{part}1", f"{part}2")
    halves = build(cheap(draft.mission(), profile), BuildOptions(profile=profile), draws())
    assert [half.part for half in halves] == ["a", "b"]
    assert halves[0].mission.header.mission_id != halves[1].mission.header.mission_id
    a, b = (walker_of(half) for half in halves)

    def see(y: float, t_s: float, x: float, *messages: bytes) -> Experience:
        doors = tuple(m for m in truths(draft.mission()) if m.y_m == y and abs(m.x_m - x) < 3)
        return Experience(t_s, x, y, 0, x, doors, messages=messages)

    state_a, _ = a.step(State(), see(0.0, 0, 0))
    state_b, _ = b.step(State(), see(50.0, 0, 0))
    _, early = until_decoded(b, state_b, see(50.0, 1, 4), 5)
    assert early.decoded is None, "b has not heard from a"
    state_a, told = until_decoded(a, state_a, see(0.0, 1, 4), 5)
    (message,) = told.decoded.sends
    assert len(message) == 32
    _, own = until_decoded(a, state_a, see(0.0, 2, 8, message), 5)
    assert own.decoded is None, "its own message means nothing to the sender"
    state_b, answered = until_decoded(b, state_b, see(50.0, 2, 4, message), 5)
    (answer,) = answered.decoded.sends
    _, done = until_decoded(a, state_a, see(0.0, 3, 8, answer), 5)
    assert done.order.kind is Kind.DONE
    _, done = until_decoded(b, state_b, see(50.0, 3, 8), 5)
    assert done.order.kind is Kind.DONE


@both
def test_a_join_opens_only_when_all_before_it_are_open(profile):
    draft = fork()
    draft.nodes[-1] = replace(draft.nodes[-1], join=True)
    draft.way("left", "right", both=True)
    mission = cheap(draft.mission(), profile)
    places = {node.name: node.place for node in mission.nodes}

    def decoded(*names: str) -> list[int]:
        steps = walk(mission, walker_of(built(mission, profile)), places=[places[n] for n in names], range_m=1)
        return [o.decoded.node for _, o in steps if o.decoded]

    assert decoded("start", "left", "end") == [0, 1]
    assert decoded("start", "left", "right", "end") == [0, 1, 2, 3]


@both
def test_one_door_seen_in_several_ways_is_one_node(profile):
    draft = Draft("aliases")
    draft.node("start", Position(0, 0), start=True)
    aliases = [Landmark("room", 5, 2, None, 40.0), Landmark("room", 6, -2, None, 40.0)]
    draft.node("room", *aliases, final=True)
    draft.way("start", "room")
    for alias in aliases:
        walker, state = at_start(draft, profile)
        _, outcome = until_decoded(walker, state, Experience(1, 3, 0, 0, 3.0, (alias,)))
        assert outcome.decoded.node == 1
        assert outcome.decoded.landmark.x_m == pytest.approx(alias.x_m, abs=1e-3)


@both
def test_a_landmark_counts_only_from_as_near_as_the_author_said(profile):
    walker, begun = at_start(leading_to(DOOR, within_m=2.0), profile)
    for x, well in ((5.0, False), (6.5, True)):
        _, outcome = until_decoded(walker, begun, Experience(1, x, 1, 0, x, (DOOR,)))
        assert (outcome.decoded is not None) is well


@both
def test_an_action_leads_on_where_the_way_says_so(profile):
    draft = Draft("lift")
    draft.node("start", Position(0, 0), start=True)
    draft.node("up", Sensor(b"floor 2"), final=True)
    draft.way("start", "up", do=Action("lift", (("floor", 2),)))
    walker = walker_for(draft, profile)
    pool = (Action("lift", (("floor", 1),)), Action("lift", (("floor", 2),)))
    state, outcome = walker.step(State(), Experience(0, 0, 0, 0, actions=pool))
    assert (outcome.order.kind, outcome.order.do) == (Kind.DO, Action("lift", (("floor", 2),)))
    _, outcome = until_decoded(walker, state, Experience(1, 0, 0, 0, sensors=(b"floor 2",), actions=pool))
    assert outcome.order.kind is Kind.DONE


def test_a_chained_node_of_the_paper_needs_what_the_one_before_released():
    draft = Draft("chain", roam=True)
    draft.node("start", Position(0, 0), start=True)
    draft.node("first", Landmark("doorway", 5, 0, 0.1))
    draft.node("second", Landmark("doorway", 9, 0, 0.3), chained=True, final=True)
    draft.way("start", "first")
    draft.way("first", "second")
    walker, state = at_start(draft, Profile.PAPER)
    second = Experience(1, 8, 0, 0, 8.0, (Landmark("doorway", 9, 0, 0.3),))
    assert walker.step(state, second)[1].decoded is None
    state, _ = walker.step(state, Experience(2, 4, 0, 0, 8.0, (Landmark("doorway", 5, 0, 0.1),)))
    assert walker.step(state, replace(second, t_s=3))[1].decoded.node == 2


@both
def test_a_code_decodes_where_it_hangs_and_not_where_somebody_hung_it_or_a_copy(profile):
    code = Landmark("qr", 6.0, 2.0, -1.57, None, "shelf 3")
    walker, begun = at_start(leading_to(code, do=Action("pick")), profile)
    cases = {
        "as it hangs": (code, True),
        "moved along the wall": (replace(code, x_m=7.2), False),
        "cloned in another room": (replace(code, x_m=30.0, y_m=20.0), False),
        "turned round": (replace(code, orientation_rad=1.57), False),
        "another text in its place": (replace(code, text="shelf 4"), False),
    }
    for case, (seen, well) in cases.items():
        experience = Experience(1, seen.x_m - 2, seen.y_m, 0, 5.0, (seen,), actions=(Action("pick"),))
        _, outcome = until_decoded(walker, begun, experience, 8)
        assert (outcome.decoded is not None) is well, case


@pytest.mark.parametrize("profile", BOTH)
@pytest.mark.parametrize("kind", ["doorway", "concave_left", "room"])
def test_a_mission_may_come_back_to_a_thing_that_another_node_is_too(kind, profile):
    """A patrol: there, on, and there again. What was known as another node's was never looked for, and it held."""
    turn, area = (None, 12.0) if kind == "room" else (0.3, None)
    there, on = Landmark(kind, 4, 3, turn, area), Landmark("doorway", 9, 1, 0.7)
    draft = Draft("patrol")
    draft.node("start", Position(0, 0), start=True)
    for name, thing in (("there", there), ("on", on), ("again", there)):
        draft.node(name, thing, final=name == "again")
    for ways in (("start", "there"), ("there", "on"), ("on", "again")):
        draft.way(*ways)
    mission = cheap(draft.mission(), profile)
    one = built(mission, profile)
    assert [node for node, *_ in decoded_of(explored(mission, walker_of(one)))] == [0, 1, 2, 3]
    # Auditors come to the same.
    owner, auditor, state = walker_of(one), Walker(one.mission, replays=True), State()
    for t_s, node in enumerate(mission.nodes, 1):
        for k in range(20):
            seen = at(mission, *node.place, t_s + k / 100)
            before, claim, _ = owner.look(state, seen)
            assert auditor.advance(before, seen, claim)[1].decoded == owner.advance(before, seen, claim)[1].decoded
            state, outcome = owner.advance(before, seen, claim)
            if outcome.decoded:
                break
    assert state.phase is Phase.DONE


def test_a_thing_that_two_nodes_are_still_tells_where_a_robot_is():
    """Known twice it seemed to be one of two that cannot be told apart, and corrected no pose any more."""
    there = Landmark("doorway", 4, 3, 0.3)
    draft = Draft("patrol")
    draft.node("start", Position(0, 0), start=True)
    for name, thing in (("there", there), ("on", Landmark("doorway", 9, 1, 0.7)), ("again", there), ("end", there)):
        draft.node(name, thing)
    for ways in (("start", "there"), ("there", "on"), ("on", "again"), ("again", "end")):
        draft.way(*ways)
    mission = cheap(draft.mission(), Profile.PAPER)
    walker, state = walker_of(built(mission, Profile.PAPER)), State()
    for t_s, node in enumerate(mission.nodes[:4], 1):
        state, outcome = until_decoded(walker, state, at(mission, *node.place, t_s))
        assert outcome.decoded is not None, node.name
    unsure = at(mission, 4.2, 2.8, 9, landmarks=(there,), spread=(0.02, 0.0, 0.0, 0.02, 0.0, 2e-3))
    assert walker.pose_from_known(state, unsure) is not None
