"""The pose that knows its doubt: its covariance is one, it covers the error, it learns the drift, and is the same bits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.mission import MissionConfig
from phalanx.mission import Landmark
from phalanx.mission.angles import wrap
from phalanx.mission.pose import belief as belief_module
from phalanx.mission.pose import spread as spread_module
from phalanx.mission.pose.belief import COUNT, NUMBERS, UPPER, Belief, belief_from_numbers
from phalanx.mission.pose.spread import (
    Sight,
    Sighting,
    corrected,
    inverse,
    misfit,
    place_deviations,
    pose_spread,
    with_floor,
)
from phalanx.mission.walk.fix import floor_of, initial_belief, odometry_errors_of, sight_of, sighting
from phalanx.world.building.odometry import NoiseModel, Odometry, OdometryNoise, along_arc

CONFIG = MissionConfig()
SIGHT, FLOOR, WHEELS = sight_of(CONFIG), floor_of(CONFIG), odometry_errors_of(CONFIG)

metres, turns = st.floats(-30, 30), st.floats(-3, 3)
moves = st.tuples(st.just("move"), st.floats(-1, 1), turns, st.booleans())
sights = st.tuples(st.just("sight"), st.tuples(metres, metres, metres, metres), turns | st.just(math.nan))


def told(belief: Belief, event) -> Belief:
    """The belief after one of the events above; what is sighted is off from what is there by whatever chance has."""
    if event[0] == "move":
        return belief.moved(event[1], event[2], WHEELS, touches=event[3])
    x, y, _ = belief.pose
    ox, oy, dx, dy = event[1]
    match = Sighting(x + ox, y + oy, x + ox + dx / 10, y + oy + dy / 10, event[2] / 10)
    return belief.corrected((match,), SIGHT, FLOOR)


@settings(deadline=None, max_examples=60)
@given(st.lists(moves | sights, max_size=40))
def test_a_covariance_stays_one_whatever_happens(events):
    belief = initial_belief(CONFIG, (1.0, 2.0, 3.0))
    for event in events:
        belief = told(belief, event)
        assert np.all(np.isfinite(belief.mean))
        assert abs(belief.pose[2]) <= math.pi + 1e-12
        assert np.array_equal(belief.spread, belief.spread.T)
        sizes = np.sqrt(np.diag(belief.spread))
        if event[0] == "sight":
            assert np.all(sizes[:3] >= np.array([FLOOR[0], FLOOR[0], FLOOR[1]]) * (1 - 1e-9))
        # Scaled to correlations, or the metres would hide the radians.
        assert np.linalg.eigvalsh(belief.spread / np.outer(sizes, sizes)).min() > -1e-9
        again = belief_from_numbers(belief.numbers)
        assert again is not None
        assert again.numbers == belief.numbers


@settings(deadline=None, max_examples=40)
@given(st.lists(moves, max_size=20))
def test_who_may_have_slipped_is_less_sure_and_who_sees_is_surer(events):
    belief = initial_belief(CONFIG, (0.0, 0.0, 0.0))
    for _, way, turn, touches in events:
        free, slipped = (belief.moved(way, turn, WHEELS, touches=each) for each in (False, True))
        assert np.all(np.diag(slipped.spread) >= np.diag(free.spread) * (1 - 1e-12))
        belief = slipped if touches else free
        _, spread = corrected(belief.mean, belief.spread, Sighting(5.0, 1.0, 5.1, 1.0, 0.02), SIGHT)
        assert np.all(np.diag(spread) <= np.diag(belief.spread) + 1e-12)


def test_turns_to_and_fro_beside_a_wall_slip_both_ways():
    """A robot in office_30x25 turned so for 12 s, and told nothing any more: its doubt was 0.78 rad, its error 0.02."""
    belief = initial_belief(CONFIG, (0.0, 0.0, 0.0))
    for k in range(120):
        belief = belief.moved(0.0, 0.12 if k % 8 < 4 else -0.12, WHEELS, touches=True)
    assert 0.05 < math.sqrt(belief.pose_covariance[5]) < 0.25


@pytest.mark.parametrize(
    ("i", "value"), [(0, math.nan), (7, math.inf), (COUNT, 0.0), (COUNT, -1.0), (COUNT + 1, 5.0), (NUMBERS - 1, -1e-9)]
)
def test_numbers_that_are_no_covariance_are_refused(i, value):
    numbers = list(initial_belief(CONFIG, (0.0, 0.0, 0.0)).numbers)
    assert belief_from_numbers(numbers) is not None
    numbers[i] = value
    assert belief_from_numbers(numbers) is None
    assert belief_from_numbers(numbers[:-1]) is None


@given(st.lists(st.floats(-3, 3), min_size=9, max_size=9))
@settings(deadline=None)
def test_an_inverse_is_one(values):
    root = np.array(values).reshape(3, 3) + 4 * np.eye(3)
    s = root @ root.T
    if np.linalg.cond(s) < 1e6:
        assert np.allclose(inverse(s) @ s, np.eye(3), atol=1e-8)


def test_a_doubt_is_what_chance_shows():
    """Poses drawn from a covariance put a landmark as far off as the covariance says."""
    chance = np.random.default_rng(3)
    spread = pose_spread((0.04, 0.01, 0.002, 0.02, -0.001, 0.001))
    off = chance.multivariate_normal(np.zeros(3), spread, 200_000)
    ox, oy = 3.0, -2.0
    places = np.stack((off[:, 0] - oy * off[:, 2], off[:, 1] + ox * off[:, 2]), axis=1)
    along_x, along_y, most = place_deviations(spread, ox, oy, Sight(0.0, 0.0, 0.0))
    assert (along_x, along_y) == pytest.approx(tuple(places.std(axis=0)), rel=0.02)
    assert most == pytest.approx(math.sqrt(np.linalg.eigvalsh(np.cov(places.T)).max()), rel=0.02)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 2), st.floats(-0.3, 0.3) | st.just(math.nan))
def test_a_misfit_is_a_mahalanobis_distance(off, turn):
    spread = pose_spread((0.04, 0.01, 0.002, 0.02, -0.001, 0.001))
    ox, oy = 3.0, -2.0
    match = Sighting(1.0 + ox, 2.0 + oy, 1.0 + ox + off[0], 2.0 + oy + off[1], turn)
    own = SIGHT.place_m + SIGHT.per_m * math.hypot(ox, oy)
    h, v = np.array([[1, 0, -oy], [0, 1, ox], [0, 0, 1]]), np.array([*off, turn])
    noise = np.diag([own**2, own**2, SIGHT.turn_rad**2])
    if math.isnan(turn):
        h, v, noise = h[:2], v[:2], noise[:2, :2]
    expected = v @ np.linalg.solve(h @ spread @ h.T + noise, v)
    assert misfit(spread, 1.0, 2.0, match, SIGHT) == pytest.approx(expected, abs=1e-9)


def kernels_of(module):
    return {name: each for name, each in vars(module).items() if hasattr(each, "py_func")}


@settings(deadline=None, max_examples=25)
@given(st.lists(moves | sights, min_size=1, max_size=12))
def test_compiled_and_plain_are_the_same_bits(events):
    compiled = initial_belief(CONFIG, (1.0, 2.0, 3.0))
    for event in events:
        compiled = told(compiled, event)
    with pytest.MonkeyPatch.context() as patch:
        for module in (belief_module, spread_module):
            for name, each in kernels_of(module).items():
                patch.setattr(module, name, each.py_func)
        assert belief_module.moved is not spread_module.corrected
        plain = initial_belief(CONFIG, (1.0, 2.0, 3.0))
        for event in events:
            plain = told(plain, event)
    assert plain.numbers == compiled.numbers
    match = Sighting(4.0, 5.0, 4.2, 4.9, 0.1)
    for one, other in zip(
        (misfit, place_deviations, with_floor),
        (misfit.py_func, place_deviations.py_func, with_floor.py_func),
        strict=True,
    ):
        block = plain.spread[:3, :3].copy()
        args = {misfit: (1.0, 2.0, match, SIGHT), place_deviations: (3.0, -2.0, SIGHT), with_floor: FLOOR}[one]
        assert np.array_equal(one(block, *args), other(block, *args))


# --- drives -----------------------------------------------------------------------------------------------------------

# Round and round a hall of 12 by 8 m, 1 m from its walls; landmarks stand in the walls every 4 m, and look into it.
LAPS, STEP_M, SIGHT_EVERY = 2, 0.1, 8


def hall() -> list[Landmark]:
    out = []
    for x in (0.0, 4.0, 8.0, 12.0):
        out += [Landmark("concave_left", x, 0.0, math.pi / 2), Landmark("concave_left", x, 8.0, -math.pi / 2)]
    return out + [Landmark("concave_left", x, 4.0, turn) for x, turn in ((0.0, 0.0), (12.0, math.pi))]


def lap() -> list[tuple[float, float]]:
    """(way, turn) of each step."""
    corner = [(0.0, math.pi / 2 / 16)] * 16
    sides = ([(STEP_M, 0.0)] * 100, [(STEP_M, 0.0)] * 60) * 2
    return [step for side in sides for step in (*side, *corner)]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of how a landmark is seen, and of how it is drawn."""

    seen_m: float
    seen_per_m: float
    seen_rad: float
    drawn_m: float
    drawn_rad: float


# As lidars show (docs/adr/0019) and maps are; and all that the configuration allows for, by chance.
REAL = Noise(0.02, 0.005, math.radians(0.6), 0.025, math.radians(0.6))
WORST = Noise(*SIGHT, 0.0, 0.0)


def driven(seed: int, model: NoiseModel, noise: Noise = REAL, *, sigma=(0.03, 0.05), laps: int = LAPS):
    """(truth, belief) after every step of a drive."""
    chance = np.random.default_rng([seed, 7])
    truth = (1.0, 1.0, 0.0)
    wheels = Odometry((0.0, 0.0, 0.0), OdometryNoise(*sigma, model), np.random.default_rng([seed, 1]))
    belief, landmarks = initial_belief(CONFIG, truth), hall()
    # A map is wrong the same way all day.
    drawn = [replace(each, **_moved_by(chance, each, noise.drawn_m, noise.drawn_rad)) for each in landmarks]
    for i, (way, turn) in enumerate(lap() * laps):
        truth, before = along_arc(truth, way, turn), wheels.pose
        belief = belief.driven(before, wheels.step(way, turn), odometry_errors_of(CONFIG))
        if i % SIGHT_EVERY == 0:
            order = sorted(range(len(landmarks)), key=lambda k: math.dist(_place(landmarks[k]), truth[:2]))
            for k in order[:2]:
                belief = belief.corrected((_seen(chance, noise, truth, belief, landmarks[k], drawn[k]),), SIGHT, FLOOR)
        yield truth, belief


def _place(landmark: Landmark) -> tuple[float, float]:
    return landmark.x_m, landmark.y_m


def _moved_by(chance, landmark: Landmark, metres: float, radians: float) -> dict[str, float]:
    x, y, turn = chance.standard_normal(3).tolist()
    return {
        "x_m": landmark.x_m + metres * x,
        "y_m": landmark.y_m + metres * y,
        "orientation_rad": landmark.orientation_rad + radians * turn,
    }


def _seen(chance, noise: Noise, truth, belief: Belief, landmark: Landmark, drawn: Landmark) -> Sighting:
    """What a robot there makes of a landmark, by its belief, and where its mission has it."""
    away = math.dist(_place(landmark), truth[:2])
    shown = replace(landmark, **_moved_by(chance, landmark, noise.seen_m + noise.seen_per_m * away, noise.seen_rad))
    x, y, heading = belief.pose
    turn = wrap(heading - truth[2])
    sine, cosine = math.sin(turn), math.cos(turn)
    dx, dy = shown.x_m - truth[0], shown.y_m - truth[1]
    at = x + cosine * dx - sine * dy, y + sine * dx + cosine * dy
    return sighting(Landmark(landmark.type, *at, shown.orientation_rad + turn), drawn, *at)


def off(truth, belief: Belief) -> np.ndarray:
    x, y, heading = belief.pose
    return np.array([x - truth[0], y - truth[1], wrap(heading - truth[2])])


def judged(drives) -> tuple[np.ndarray, np.ndarray]:
    """(error in deviations, by coordinate; square of its Mahalanobis distance) on every step of drives."""
    shares, squares = [], []
    for truth, belief in drives:
        wrong, spread = off(truth, belief), belief.spread[:3, :3]
        shares.append(np.abs(wrong) / np.sqrt(np.diag(spread)))
        squares.append(wrong @ np.linalg.solve(spread, wrong))
    return np.array(shares), np.array(squares)


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 50), marks=pytest.mark.long)], ids=str)
@pytest.mark.parametrize("model", NoiseModel)
def test_the_error_is_within_three_deviations_on_every_step_of_fifty_drives(model, seeds):
    for seed in seeds:
        shares, squares = judged(driven(seed, model))
        assert shares.max() <= 3, (seed, shares.max(axis=0))
        # Of three coordinates 3, were the doubt exactly the error's. No pose is called surer than maps are.
        assert 0.1 < squares.mean() < 3, "neither too sure, nor so unsure that the doubt says nothing"


@pytest.mark.parametrize("model", NoiseModel)
def test_where_landmarks_are_seen_as_badly_as_allowed_for_the_doubt_is_no_smaller_than_the_error(model):
    judgements = [judged(driven(seed, model, WORST)) for seed in range(20)]
    shares, squares = (np.concatenate(each) for each in zip(*judgements, strict=True))
    assert np.mean(shares.max(axis=1) > 3) < 0.003
    assert 0.5 < squares.mean() < 3


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3, 4))])
def test_odometry_that_always_errs_alike_is_learnt(seed):
    *_, (_, belief) = driven(seed, NoiseModel.FIXED, laps=6)
    way, turn, curve = belief.drift
    # It tells 1.03 m of 1 m, and 1.05 rad of 1 rad.
    assert way == pytest.approx(1 / 1.03 - 1, abs=0.008)
    assert turn == pytest.approx(1 / 1.05 - 1, abs=0.008)
    assert curve == pytest.approx(0.0, abs=0.004)
    before = initial_belief(CONFIG, (0.0, 0.0, 0.0)).spread
    share = np.diag(belief.spread)[3:] / np.diag(before)[3:]
    assert np.all(share < [0.25, 0.25, 0.5]), "and the robot knows that it has"


def test_wheels_that_are_true_are_learnt_to_be_so():
    *_, (_, belief) = driven(1, NoiseModel.FIXED, sigma=(0.0, 0.0), laps=6)
    assert belief.drift == pytest.approx((0.0, 0.0, 0.0), abs=0.008)


def test_a_robot_that_drives_where_nothing_is_seen_doubts_more_and_more():
    belief, doubts = initial_belief(CONFIG, (0.0, 0.0, 0.0)), []
    for _ in range(200):
        belief = belief.moved(0.1, 0.0, WHEELS)
        doubts.append(math.sqrt(belief.spread[0, 0] + belief.spread[1, 1]))
    assert doubts == sorted(doubts)
    # 5 % of the way, half a degree a metre over 20 m: more than a metre across.
    assert 1.0 < doubts[-1] < 3.0


def test_the_numbers_of_a_belief_are_its_mean_and_its_upper_triangle():
    belief = initial_belief(CONFIG, (1.0, 2.0, 0.5)).moved(1.0, 0.2, WHEELS)
    assert len(belief.numbers) == NUMBERS == COUNT + len(UPPER)
    assert belief.numbers[:3] == belief.pose
    assert belief.numbers[3:6] == belief.drift
    assert tuple(pose_spread(belief.pose_covariance).ravel()) == tuple(belief.spread[:3, :3].ravel())
