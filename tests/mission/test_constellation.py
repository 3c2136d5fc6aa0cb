"""Where things stand that nobody surveyed: one match is not enough, several that agree are."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from phalanx.config.mission import MissionConfig
from phalanx.mission import Draft, Experience, Landmark, Position, Profile, Reason, State, Walker
from phalanx.mission.pose.belief import Belief
from phalanx.mission.walk.chart import Chart
from phalanx.mission.walk.constellation import expected_chance_matches, fix_from_known
from phalanx.mission.walk.fix import fix_from, fixed, initial_belief
from worlds import walker_for

STRANGERS = MissionConfig(strangers_per_m2=0.2)
NEAR = Landmark("concave_left", 3.0, 1.0, math.pi, apart_m=25.0)
FAR = Landmark("concave_right", 4.0, -2.0, math.pi, apart_m=25.0)
DOOR = Landmark("doorway", 5.0, 2.5, 0.3, apart_m=25.0)
SAME_SHELF = Landmark("concave_right", 3.0, 0.4, math.pi, apart_m=25.0)


def spread_of(place_m: float, turn_rad: float) -> tuple[float, float, float, float, float, float]:
    return place_m**2, 0.0, 0.0, place_m**2, 0.0, turn_rad**2


def sees(landmarks: tuple[Landmark, ...], off: tuple[float, float, float], place_m: float, deg: float) -> Experience:
    """What a robot at the origin sees that believes to be `off`: metres, metres, degrees."""
    turn = math.radians(off[2])
    sine, cosine = math.sin(turn), math.cos(turn)
    placed = tuple(
        replace(
            each,
            x_m=off[0] + cosine * each.x_m - sine * each.y_m,
            y_m=off[1] + sine * each.x_m + cosine * each.y_m,
            orientation_rad=math.remainder((each.orientation_rad or 0.0) + turn, math.tau),
        )
        for each in landmarks
    )
    return Experience(1.0, off[0], off[1], turn, 5.0, placed, spread=spread_of(place_m, math.radians(deg)))


def walker_to(*landmarks: Landmark) -> Walker:
    draft = Draft("strangers", roam=True)
    draft.node("start", Position(0, 0), start=True)
    for i, landmark in enumerate(landmarks):
        draft.node(f"n{i}", landmark)
        draft.way("start", f"n{i}", both=True)
    walker = walker_for(draft, Profile.PAPER)
    return Walker(walker.mission, config=STRANGERS)


@pytest.mark.parametrize("shown", [(NEAR,), (NEAR, SAME_SHELF)])
def test_one_thing_is_not_believed_by_who_is_unsure_by_decimetres_nor_two_ends_of_it(shown):
    walker = walker_to(NEAR, SAME_SHELF, FAR)
    begun, _ = walker.step(State(), Experience(0, 0, 0, 0))
    seen = sees(shown, (0.3, -0.2, 5.0), 0.3, 5.0)
    _, outcome = walker.step(begun, seen)
    assert (outcome.decoded, outcome.fix, outcome.reason) == (None, None, Reason.UNCONFIRMED)
    surveyed_whole = Walker(walker.mission, config=replace(STRANGERS, strangers_per_m2=0.0))
    assert surveyed_whole.step(begun, seen)[1].decoded is not None


def test_things_that_agree_are_believed_together_before_any_of_them_is_known():
    walker = walker_to(NEAR, FAR, DOOR)
    state, _ = walker.step(State(), Experience(0, 0, 0, 0))
    seen = sees((NEAR, FAR, DOOR), (0.5, -0.4, 9.0), 0.4, 8.0)
    decoded = set()
    for k in range(3):
        state, outcome = walker.step(state, replace(seen, t_s=1.0 + k))
        assert outcome.fix is not None and len(outcome.fix.sightings) == 3
        assert math.hypot(outcome.fix.x_m, outcome.fix.y_m) < 0.15
        assert abs(math.degrees(outcome.fix.heading_rad)) < 3.0
        decoded.add(outcome.decoded.node)
    assert len(decoded) == 3


def test_a_stranger_beside_known_things_is_left_out_of_their_constellation():
    stranger = replace(DOOR, x_m=DOOR.x_m + 0.9, y_m=DOOR.y_m - 0.5)
    post = Landmark("concave_left", 6.0, -4.0, math.pi / 2)
    shown = sees((NEAR, FAR, stranger, post), (0.5, -0.4, 9.0), 0.4, 8.0)
    fix = fix_from_known(STRANGERS, shown, Chart((NEAR, FAR, DOOR, post)))
    assert fix is not None
    assert math.hypot(fix.x_m, fix.y_m) < 0.15
    assert (DOOR.x_m, DOOR.y_m) not in [(each.x_m, each.y_m) for each in fix.sightings]


@pytest.mark.parametrize(("places_m", "well"), [((-1.2, 0.0, 1.2), False), ((-1.2, 0.3, 2.6), True)])
def test_a_row_that_goes_on_alike_is_not_believed_by_who_may_be_a_post_further(places_m, well):
    """Of posts 1.2 m apart two fit the next ones as well; where they stand at odd distances nothing else fits."""
    row = tuple(Landmark("concave_left", 3.0, y_m, math.pi) for y_m in places_m)
    shown = sees(row, (0.1, 0.6, 0.0), 0.6, 2.0)
    assert (fix_from_known(STRANGERS, shown, Chart(row)) is not None) is well


def test_strangers_are_counted_in_what_is_left_of_each_gate():
    seen = sees((NEAR, FAR), (0.3, -0.2, 5.0), 0.3, 5.0)
    one, both = [(seen.landmarks[0], NEAR)], [(seen.landmarks[0], NEAR), (seen.landmarks[1], FAR)]
    assert expected_chance_matches(MissionConfig(), seen, both) == 0.0
    of_one_piece = [one[0], (replace(seen.landmarks[0], y_m=seen.landmarks[0].y_m - 0.6), SAME_SHELF)]
    assert expected_chance_matches(STRANGERS, seen, of_one_piece) == expected_chance_matches(STRANGERS, seen, one)
    assert expected_chance_matches(STRANGERS, seen, both) < expected_chance_matches(STRANGERS, seen, one) ** 2
    doubled = replace(STRANGERS, strangers_per_m2=0.4)
    assert expected_chance_matches(doubled, seen, both) == pytest.approx(
        4 * expected_chance_matches(STRANGERS, seen, both)
    )


def test_a_pose_that_is_turned_far_is_no_surer_than_an_arc_differs_from_its_tangent():
    config = STRANGERS
    for off_deg, least_m, most_m in ((2.0, 0.0, 0.06), (30.0, 0.4, 1.0)):
        seen = sees((FAR, DOOR), (0.0, 0.0, off_deg), 0.3, 15.0)
        belief = initial_belief(config, (seen.x_m, seen.y_m, seen.heading_rad))
        spread = belief.spread.copy()
        spread[0, 0] = spread[1, 1] = 0.09
        spread[2, 2] = math.radians(15.0) ** 2
        fix = fix_from(config, seen, list(zip(seen.landmarks, (FAR, DOOR), strict=True)))
        after = fixed(config, Belief(belief.mean, spread), fix)
        assert least_m <= math.sqrt(after.spread[0, 0]) <= most_m, off_deg
