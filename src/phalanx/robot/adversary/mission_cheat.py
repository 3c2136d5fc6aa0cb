"""Compromised robots on a mission that peers audit, and the knowledge of their adversary.

As in liar.py, a robot is honest until the attack begins, and an honest controller runs in parallel. The first output
that differs from the honest controller's is the deviation from which the bound of promise P1 counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from phalanx.bti import request
from phalanx.bti.fleet import Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_T
from phalanx.bti.work import Work
from phalanx.mission.walk.state import Keyring
from phalanx.robot.actions import Action
from phalanx.robot.adversary.attack import Scene
from phalanx.robot.controllers.mission.controller import MissionController
from phalanx.robot.controllers.mission.surroundings import Pose
from phalanx.robot.controllers.python_controller import Output
from phalanx.robot.robot import MakeController, Robot
from phalanx.wire.fields import get_u32


@dataclass(frozen=True, slots=True, kw_only=True)
class CheatPlan:
    """Plan and knowledge of the adversary: the building, and the nodes that colluding robots have decoded."""

    after_ms: int  # time from the mission key to the start of the attack
    toward_m: tuple[float, float] = (0.0, 0.0)  # the adversary's destination, map frame
    # Makes the bytes of a scan from a pose in a building of the adversary's choice
    imagine: Callable[[Pose], bytes] = lambda _pose: b""
    # Gates that colluding robots have opened
    keys: Keyring = Keyring()  # noqa: RUF009  # frozen
    node: int = 0  # node to skip
    onward: int = 0  # the node after it


class MissionCheat(Robot):
    """Robot with a compromised c-node on a mission."""

    scene: ClassVar[Scene] = "team"

    def __init__(self, fleet: Fleet, i: int, work: Work, make_controller: MakeController, *, plan: CheatPlan) -> None:
        super().__init__(fleet, i, work, make_controller)
        self.is_own = False  # do not report its errors as mistakes in a user's controller
        self.plan = plan
        self.first_deviation_ms: int | None = None
        self.output_missing = False
        self._honest = make_controller(self.id)
        self._from_ms = 0

    @property
    def mission(self) -> MissionController:
        """Return the controller that the attack manipulates."""
        assert isinstance(self.controller, MissionController)
        return self.controller

    def take_over(self, controller: MissionController) -> None:
        """Continue from the state of an honest robot during its mission."""
        assert isinstance(self._honest, MissionController)
        self.controller, self._honest.memory = controller, controller.memory

    def on_boot(self, now_ms: int) -> None:
        self._from_ms = now_ms + self.plan.after_ms
        super().on_boot(now_ms)

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        if not packet[0] & request.AUDIT:
            self._honest.on_recv(now_ms, packet)
        return super().on_packet(now_ms, packet)

    def decide(self, entry_len: int) -> list[Output]:
        reading = self.w.entry[ENTRY_HEAD_BYTES:entry_len].tobytes()
        step, t_ms = int(self._step_of[self.i]), get_u32(self.w.entry, ENTRY_T)
        assert isinstance(self._honest, MissionController)
        due = self._honest.on_evidence(step, t_ms, reading, self._honest.keep(step, t_ms, reading, self.raw))
        if t_ms < self._from_ms:
            return super().decide(entry_len)
        outputs = self.lie(step, t_ms, reading)
        self.f.robot[self.i].step = step + 1
        self.keep_state()
        if outputs != due and self.first_deviation_ms is None:
            self.first_deviation_ms, self.output_missing = t_ms, len(outputs) < len(due)
        return outputs

    def lie(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """Return the outputs of the attack; this base class returns the honest ones."""
        evidence = self.evidence(step, t_ms, reading)
        self.keep_evidence(evidence)
        return self.mission.on_evidence(step, t_ms, reading, evidence)
