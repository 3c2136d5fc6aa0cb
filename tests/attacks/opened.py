"""Holes opened again: guards cut out of what a robot does with a packet, which runs uncompiled for that."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import pytest

from phalanx.bti import request
from phalanx.robot import handlers
from phalanx.robot.robot import Robot
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited.world import PYTHON
from phalanx.world.scenarios.run import Run

# From the events of a robot in Python down to the guards.
CHAIN = [
    *((handlers, name) for name in ("on_packet", "hear", "handle_audit", "store_fragment")),
    (request, "take_fragment"),
]


@dataclass(frozen=True)
class Hole:
    """In the source of a kernel stands a guard; with the hole open, something else."""

    module: ModuleType
    name: str
    guard: str
    instead: str = ""

    def opened(self) -> Callable[..., object]:
        """The kernel without its guard, uncompiled."""
        source = inspect.getsource(getattr(self.module, self.name).py_func).removeprefix("@kernel\n")
        assert source.count(self.guard) == 1, f"{self.name} has this guard no more: {self.guard}"
        made: dict[str, Callable[..., object]] = {}
        exec(source.replace(self.guard, self.instead), vars(self.module), made)
        return made[self.name]


def run_with(patch: pytest.MonkeyPatch, made: Scenario, *holes: Hole) -> Run:
    """The scenario to its end, with these holes open in all robots; with none of them, the defence as it is."""
    with patch.context() as within:
        opened = [(hole, hole.opened()) for hole in holes]
        for module, name in CHAIN:
            within.setattr(module, name, getattr(module, name).py_func)
        for hole, function in opened:
            within.setattr(hole.module, hole.name, function)
        running = Run(made)
        for i in range(made.robots):
            running.robots.setdefault(i, Robot(running.world.fleet, i, running.world.work))
            running.world.runs[i] = PYTHON
        running.advance(made.duration_s)
    return running
