"""Let idle demo robots carry out a protocol, as in scenarios but on wheels.

The protocol runs in plain Python, so that a working swarm needs more processor time than a waiting one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Params
from phalanx.config import BtiConfig
from phalanx.errors import UsageError
from phalanx.robot.controllers.bundled.wheels import CAPACITY_BYTES, ROUTE
from phalanx.robot.controllers.keep_apart import NEAR_BYTES, encode_near
from phalanx.robot.controllers.peers import PeerController
from phalanx.robot.controllers.places import PLACES_A_SIDE
from phalanx.robot.controllers.protocol import Point, Stage, Task, find_protocol, protocols
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.swarm import Done
from phalanx.wire.table import WHEELS_SENSOR
from phalanx.world.audited.pybot import ExtraSensors

from .dotbots import AREA_MM

EDGE_M, SIDE_M = 0.25, AREA_MM[0] / 1000 - 0.5
RING_M = 0.62  # radius of the sentries' ring, which leaves intruders some distance to cover
LATELY_S = 120.0  # period over which the score is shown

Posts = tuple[float, tuple[Point, ...]]  # a step, m, and the post of each robot; () for the starting positions


def places(_starts_m: NDArray[np.float64]) -> Posts:
    """Return a square grid for all robots."""
    return SIDE_M / (PLACES_A_SIDE - 1), ()


def ring(starts_m: NDArray[np.float64]) -> Posts:
    """Return posts on a ring around the middle, in the robots' present order."""
    x, y = (starts_m - EDGE_M - SIDE_M / 2).T
    count, posts = len(starts_m), np.empty_like(starts_m)
    turns = np.arange(count) * math.tau / count
    posts[np.argsort(np.arctan2(y, x))] = np.stack((-np.cos(turns), -np.sin(turns)), axis=1) * RING_M
    return 2 * RING_M * math.sin(math.pi / count), _points(posts + EDGE_M + SIDE_M / 2)


def square(starts_m: NDArray[np.float64]) -> Posts:
    """Return posts in rows, in the robots' present order: the topmost in the first row."""
    edge = math.ceil(math.sqrt(len(starts_m)))
    step_m, posts = SIDE_M / (edge - 1), np.empty_like(starts_m)
    by_y = np.argsort(starts_m[:, 1])
    for j in range(0, len(by_y), edge):
        row = by_y[j : j + edge]
        row = row[np.argsort(starts_m[row, 0])]
        posts[row] = np.stack((np.arange(len(row)), np.full(len(row), j // edge)), axis=1) * step_m
    return step_m, _points(posts + EDGE_M)


def _points(places_m: NDArray[np.float64]) -> tuple[Point, ...]:
    return tuple((x_m, y_m) for x_m, y_m in places_m.tolist())


# By protocol: the posts, and the largest number of robots. In plain Python 40 robots take a third of a core; on a ring
# of more than twelve, two would have to touch to catch an intruder; more than 16 in a square are untested.
# `warehouse` is missing, because robots that visitors may drive do not stay in a grid's lanes.
ON_WHEELS: Mapping[str, tuple[Callable[[NDArray[np.float64]], Posts], int]] = {
    "exploration": (places, 40),
    "patrol": (places, 40),
    "perimeter": (ring, 12),
    "tracking": (square, 16),
}


def check_work(protocol: str, robots: int) -> None:
    """Check that this number of wheeled robots can do the protocol. Raises: UsageError."""
    if protocol not in ON_WHEELS:
        known = f"use {', '.join(ON_WHEELS)}; run others with phalanx sim view" * (protocol in protocols())
        raise UsageError(f"wheeled robots cannot do {protocol!r}", known or f"use {', '.join(ON_WHEELS)}")
    most = ON_WHEELS[protocol][1]
    if robots > most:
        raise UsageError(f"{robots} robots for {protocol}", f"use at most {most}")


class NearLooks:
    """Sensors of a stage, followed by nearby robots at their own last readings' positions."""

    def __init__(self, stage: Stage, starts_m: Sequence[Point]) -> None:
        self._stage, self._at_m = stage, dict(enumerate(starts_m, 1))

    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """See `ExtraSensors`."""
        self._at_m[rob_id] = place_m
        others = [at_m for other, at_m in self._at_m.items() if other != rob_id]
        return self._stage.look(rob_id, t_s, place_m, lies=lies) + encode_near(place_m, others)


class Work:
    """One protocol for robots at (N, 2) `starts_m`; `check_work` must have accepted it.

    Attributes:
        bti: the swarm's configuration, with room for the robots' readings and state.
        make_controller: makes a controller from a robot's id.
        stage: simulates the work's environment, and keeps the score.
        looks: sensors beyond the robots' own motion: the stage's, and with `keeps_apart` nearby robots.
    """

    def __init__(
        self,
        protocol: str,
        bti: BtiConfig,
        params: Params,
        starts_m: NDArray[np.float64],
        seed: int,
        *,
        keeps_apart: bool = False,
    ) -> None:
        found = find_protocol(protocol)
        assert found is not None, "all protocols of ON_WHEELS exist"
        step_m, posts_m = ON_WHEELS[protocol][0](starts_m)
        task = Task(
            starts_m=_points(starts_m.astype(np.float32)),  # the precision of checkpoints
            step_m=step_m,
            origin_m=(EDGE_M, EDGE_M),
            boxes=(),
            seed=seed,
            control_ms=bti.t_control_ms,
            state_every=bti.steps_per_state,
            doubt_ms=bti.stop_bound_ms(output_missing=True),
            wheels=params,
            posts_m=posts_m,
            keeps_apart=keeps_apart,
        )
        self.protocol = protocol
        self.make_controller = found.maker(task)
        self.stage = found.stage(task)
        self.looks: ExtraSensors = NearLooks(self.stage, task.starts_m) if keeps_apart else self.stage
        self.bti = replace(
            bti,
            state_bytes=len(self.make_controller(1).encode()) + CAPACITY_BYTES - ROUTE,
            reading_bytes=WHEELS_SENSOR.size + self.stage.seen_bytes + NEAR_BYTES * keeps_apart,
        )

    def aim_m(self, controller: Controller | None, now_ms: int) -> Point | None:
        """Return the goal of an honest idle robot, m; None while it is driven or held."""
        assert isinstance(controller, PeerController), "made by make_controller"
        return None if controller.body.is_taken(now_ms) else controller.target_point()

    def done(self, now_s: float) -> Done:
        """Return the recent score; drop older history, which would grow."""
        self.stage.forget(max(0.0, now_s - LATELY_S))
        stage, score = self.stage, self.stage.score_so_far(())
        return Done(name=self.protocol, score=score, counts=stage.counts, lately_s=max(1.0, now_s - stage.since_s))

    def objects_m(self, now_s: float) -> list[Point]:
        """Return the positions of the work's objects in the area."""
        return [(x, y) for x, y in self.stage.things(now_s).values() if 0 <= x <= AREA_MM[0] / 1000 >= y >= 0]
