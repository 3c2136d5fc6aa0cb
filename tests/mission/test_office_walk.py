"""The office, walked by robots whose odometry drifts and whose sensors are noisy: all of it decodes, nothing false."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from phalanx.cli.mission.files import read_plain
from phalanx.config.mission import MissionConfig
from phalanx.mission import Experience, Kind, Landmark, Phase, State, Walker
from phalanx.mission.landmarks.sites import landmarks_of
from phalanx.mission.walk.fix import fixed, initial_belief, wheels_of
from phalanx.world.building.floorplan import load_floorplan
from worlds import BOTH, built, cheap

CONFIG = MissionConfig()
RANGE_M = 12.0
STEP_M, TURN_RAD = 0.05, 0.15
NOISE_M, NOISE_RAD, NOISE_M2 = 0.02, 0.015, 0.3
FALSE_M = 0.6


class Robot:
    """A point that sees landmarks over 270 degrees and drives as its order says; Stage's odometry (0.03, 0.05)."""

    def __init__(self, plan, seed: int) -> None:
        self.plan, self.rng = plan, random.Random(seed)
        self.landmarks = [alias for site in landmarks_of(plan) for alias in site.aliases]
        self.x, self.y, self.heading = plan.start
        self.belief, self.wheels = initial_belief(CONFIG, plan.start), plan.start
        self.scale, self.turn_scale = (self.rng.uniform(-sigma / 2, sigma / 2) for sigma in (0.03, 0.05))
        self.travelled = 0.0
        self.leg, self.arrived = None, False

    def sense(self, t_s: float) -> Experience:
        seen = []
        for truth in self.landmarks:
            dx, dy = truth.x_m - self.x, truth.y_m - self.y
            if math.hypot(dx, dy) > RANGE_M:
                continue
            ahead = math.cos(self.heading) * dx + math.sin(self.heading) * dy
            left = math.cos(self.heading) * dy - math.sin(self.heading) * dx
            if ahead < 0 and abs(left) < -ahead:
                continue
            if self.plan.sees((self.x, self.y), (truth.x_m - 0.02 * dx, truth.y_m - 0.02 * dy)):
                seen.append(self._measured(truth, ahead, left))
        return Experience(t_s, *self.belief.pose, self.travelled, tuple(seen), spread=self.belief.doubt)

    def _measured(self, truth: Landmark, ahead: float, left: float) -> Landmark:
        gauss = self.rng.gauss
        ahead, left = ahead + gauss(0, NOISE_M), left + gauss(0, NOISE_M)
        x, y, heading = self.belief.pose
        cosine, sine = math.cos(heading), math.sin(heading)
        orientation, area = truth.orientation_rad, truth.area_m2
        if orientation is not None:
            orientation += heading - self.heading + gauss(0, NOISE_RAD)
        return replace(
            truth,
            x_m=x + cosine * ahead - sine * left,
            y_m=y + sine * ahead + cosine * left,
            orientation_rad=orientation,
            area_m2=None if area is None else area + gauss(0, NOISE_M2),
        )

    def believe(self, fix) -> None:
        self.belief = fixed(CONFIG, self.belief, fix)

    @property
    def error_m(self) -> float:
        return math.dist(self.belief.pose[:2], (self.x, self.y))

    def drive(self, order) -> None:
        (x, y), (est_x, est_y, est_heading) = order.place_m, self.belief.pose
        if self.leg != (order.target, order.place_m):
            self.leg, self.arrived = (order.target, order.place_m), False
        self.arrived = self.arrived or math.hypot(x - est_x, y - est_y) < 0.4
        if order.toward_m:
            x, y = order.toward_m
        wanted = math.atan2(y - est_y, x - est_x)
        if self.arrived and not order.toward_m:
            along = order.direction_rad
            off = (est_y - y) * math.cos(along) - (est_x - x) * math.sin(along)
            wanted = along - max(-0.8, min(0.8, off))
        error = (wanted - est_heading + math.pi) % (2 * math.pi) - math.pi
        turn, step = max(-TURN_RAD, min(TURN_RAD, error)), STEP_M if abs(error) < 0.6 else 0.0
        self.heading += turn
        self.x, self.y = self.x + step * math.cos(self.heading), self.y + step * math.sin(self.heading)
        step *= 1 + self.scale
        x, y, heading = self.wheels
        heading += turn * (1 + self.turn_scale)
        after = x + step * math.cos(heading), y + step * math.sin(heading), heading
        self.belief = self.belief.driven(self.wheels, after, wheels_of(CONFIG))
        self.wheels = after
        self.travelled += step


@pytest.mark.parametrize(
    "profile, seed",
    [(BOTH[1], 1), *(pytest.param(*more, marks=pytest.mark.long) for more in zip((*BOTH, BOTH[0]), (1, 0, 0)))],
)
def test_every_node_of_the_office_decodes_and_no_fix_is_false(profile, seed):
    mission = cheap(read_plain("office"), profile)
    one = built(mission, profile)
    walker, state = Walker(one.mission, one.key), State()
    robot = Robot(load_floorplan("office_40x40"), seed)
    for i in range(6000):
        state, outcome = walker.step(state, robot.sense(0.1 * i))
        if outcome.fix:
            robot.believe(outcome.fix)
            assert robot.error_m < FALSE_M, i
        if outcome.decoded and outcome.decoded.landmark:
            truth = outcome.decoded.landmark
            aliases = [alias[0] for alias in mission.nodes[outcome.decoded.node].see]
            assert min(math.hypot(truth.x_m - a.x_m, truth.y_m - a.y_m) for a in aliases) < 2e-3
        if outcome.order.kind is Kind.DONE:
            break
        if outcome.order.kind in (Kind.GO, Kind.BACK):
            robot.drive(outcome.order)
    assert state.phase is Phase.DONE
    assert len(state.opened) == 33
