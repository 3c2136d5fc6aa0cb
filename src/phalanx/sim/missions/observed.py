"""A mission robot's controller that keeps a stopwatch: nothing depends on how long searches took."""

from __future__ import annotations

from dataclasses import replace

from phalanx.mission import Experience, Landmark, Outcome, Phase, State, Walker
from phalanx.mission.walk.claims import Claim
from phalanx.robot.controllers.mission.controller import MissionController, Missions
from phalanx.robot.controllers.mission.pilot import Pose
from phalanx.sim.compiling import working_s


class ObservedController(MissionController):
    """The robot's own controller, as the world watches it.

    Attributes:
        outcome: of its last step, None before the first.
        search_ms, extraction_ms: of each step in which something was tried or seen.
    """

    def __init__(self, rob_id: int, missions: Missions, walker: Walker) -> None:
        super().__init__(rob_id, missions, walker)
        self.outcome: Outcome | None = None
        self.search_ms: list[float] = []
        self.extraction_ms: list[float] = []

    @property
    def over(self) -> bool:
        """Whether it has stopped for good."""
        return self.memory.walk.phase in (Phase.DONE, Phase.HELD)

    def landmarks(self, scan: bytes, pose: Pose) -> tuple[Landmark, ...]:
        """As the robot's."""
        began = working_s()
        found = super().landmarks(scan, pose)
        self.extraction_ms.append(1e3 * (working_s() - began))
        return found

    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """As the robot's."""
        self.tries, began = 0, working_s()
        kept = super().keep(step, t_ms, reading, raw)
        if self.tries:
            self.search_ms.append(1e3 * (working_s() - began))
        return kept

    def walk(self, seen: Experience, claims: tuple[Claim, ...]) -> tuple[State, Outcome]:
        """As the robot's."""
        began = working_s()
        walk, outcome = super().walk(seen, claims)
        if outcome.trials:
            self.search_ms.append(1e3 * (working_s() - began))
        self.outcome = replace(outcome, trials=outcome.trials + self.tries)
        return walk, outcome
