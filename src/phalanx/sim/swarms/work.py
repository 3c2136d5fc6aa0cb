"""What a protocol has the demo's robots do while nobody drives them: what point masses do in scenarios, on wheels.

It is run in plain Python, so that a swarm that works costs more than one that waits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.errors import UsageError
from phalanx.robot.cnode import CNode
from phalanx.robot.controllers.bundled.wheels import CAPACITY_BYTES, ROUTE
from phalanx.robot.controllers.declaration import Params
from phalanx.robot.controllers.peers import PeerController
from phalanx.robot.controllers.places import PLACES_A_SIDE
from phalanx.robot.controllers.protocol import Point, Task, find_protocol, protocols

from .dotbots import AREA_MM

EDGE_M = 0.25
# Those that ask of a robot no more than to be at places: wheels neither see things nor keep to a grid's lanes.
ON_WHEELS = ("exploration", "patrol")
# Each replays f_max + 1 others in plain Python, ten steps a second: of 20 that takes a tenth of a core, of 40 a third.
MOST_AT_WORK = 40


def check_work(protocol: str, robots: int) -> None:
    """So many robots on wheels can do it. Raises: UsageError."""
    if protocol not in ON_WHEELS:
        known = f"{', '.join(ON_WHEELS)}; others with phalanx sim view" * (protocol in protocols())
        raise UsageError(f"no wheels can do {protocol!r}", known or ", ".join(ON_WHEELS))
    if robots > MOST_AT_WORK:
        raise UsageError(f"{robots} robots that do {protocol}", f"at most {MOST_AT_WORK}: they run in plain Python")


class Work:
    """One protocol, for robots that stand at (N, 2) `starts_m`; `check_work` has let it through.

    Attributes:
        bti: the swarm's, with room for what a robot remembers.
        make_controller: for a robot's id.
        stage: what counts what has come of it.
    """

    def __init__(self, protocol: str, bti: BtiConfig, params: Params, starts_m: NDArray[np.float64], seed: int) -> None:
        found = find_protocol(protocol)
        assert found is not None, "as all ON_WHEELS"
        task = Task(
            starts_m=tuple((x_m, y_m) for x_m, y_m in starts_m.astype(np.float32).tolist()),  # as checkpoints say it
            step_m=(AREA_MM[0] / 1000 - 2 * EDGE_M) / (PLACES_A_SIDE - 1),
            origin_m=(EDGE_M, EDGE_M),
            boxes=(),
            seed=seed,
            control_ms=bti.t_control_ms,
            state_every=bti.steps_per_state,
            doubt_ms=bti.stop_bound_ms(output_missing=True),
            wheels=params,
        )
        self.protocol = protocol
        self.make_controller = found.maker(task)
        self.stage = found.stage(task)
        self.bti = replace(bti, state_bytes=len(self.make_controller(1).encode()) + CAPACITY_BYTES - ROUTE)

    def aim_m(self, cnode: CNode, now_ms: int) -> Point | None:
        """Where an honest robot goes by itself; None while it is driven or held."""
        controller = cnode.controller
        assert isinstance(controller, PeerController), "as made here"
        return None if controller.body.is_taken(now_ms) else controller.aim()
