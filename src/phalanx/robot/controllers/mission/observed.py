"""A mission's controller that keeps what came of its last step, for whoever watches the robot."""

from __future__ import annotations

from dataclasses import replace

from phalanx.mission import Experience, Outcome, Phase, State, Walker
from phalanx.mission.walk.claims import Claim

from .controller import MissionController, Missions


class ObservedController(MissionController):
    """The robot's own controller, observed: no decision reads what is kept here.

    Attributes:
        outcome: of its last step, None before the first.
        seen: what it experienced in that step.
    """

    def __init__(self, rob_id: int, missions: Missions, walker: Walker) -> None:
        super().__init__(rob_id, missions, walker)
        self.outcome: Outcome | None = None
        self.seen: Experience | None = None

    @property
    def over(self) -> bool:
        """Whether it has stopped for good."""
        return self.memory.walk.phase in (Phase.DONE, Phase.HELD)

    def spread(self) -> tuple[float, float, float, float, float, float]:
        """Return how uncertain it takes its pose to be."""
        doubt: tuple[float, float, float, float, float, float] = self.memory.belief.doubt
        return doubt

    def walk(self, seen: Experience, claim: Claim | None) -> tuple[State, Outcome]:
        """As the robot's."""
        walk, outcome = super().walk(seen, claim)
        self.outcome = replace(outcome, trials=outcome.trials + self.tries) if self.tries else outcome
        self.seen = seen
        return walk, outcome
