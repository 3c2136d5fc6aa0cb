"""Simulated bodies in real time, for robots that run as separate processes.

The summary and the recording are the same as for a simulated run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.refusal import Refusal
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers.senses import Senses
from phalanx.scenarios.scenario import WHEELS, Scenario
from phalanx.wire.fields import row
from phalanx.world.audited import body, loop
from phalanx.world.scenarios.run import Run

STOP = b"\0"  # stop command of the trusted nodes to the motors; drive commands begin with another byte


class Field(Run):
    """Run of a scenario whose robots are separate processes; `failed` has cause and time of early ends, by robot id."""

    has_station = True

    def __init__(self, scenario: Scenario, senses: Senses | None, on_air: Mapping[int, str]) -> None:
        self._gone = np.zeros(scenario.robots, bool)
        super().__init__(scenario)
        self.sense(senses)
        self._drawn = scenario.drawn_attacks()
        self._moving = np.zeros(scenario.robots, bool)
        self._states: dict[int, Mapping[str, Any]] = {}
        self._on_air = on_air  # attack by robot; these do not count as correct
        self.failed: dict[int, tuple[str, float]] = {}

    def advance(self, until_s: float) -> None:
        """Move the bodies to their positions at this time; call every 50 ms or so."""
        clock = self.world.clock[0]
        clock.now_us = max(round(until_s * 1e6), int(clock.now_us))
        loop.move(self.world)
        while (self._sampled_s + 1) * 1_000_000 <= clock.now_us:
            self._sample()
        self._wall_s = self.now_s

    def sensed(self, i: int, now_ms: int) -> bytes:
        """Return robot i's sensor reading at this time of its own clock."""
        body.advance(self.world, i)
        length = body.sensed(self.world, i, i + 1, now_ms)
        reading: bytes = self.world.reading[:length].tobytes()
        if self.looks:
            x_m, y_m = self.world.pos[i].tolist()
            reading += self.looks.look(i + 1, self.now_s, (x_m, y_m), lies=self._lies(i))
        return reading

    def _lies(self, i: int) -> bool:
        """Return whether robot i must report false readings now."""
        spec = next((each for each in self._drawn if each.robot == i + 1), None)
        return spec is not None and spec.at_s <= self.now_s < (math.inf if spec.until_s is None else spec.until_s)

    def drive(self, i: int, command: bytes) -> None:
        """Execute a command of robot i's trusted nodes to its motors."""
        if command == STOP:
            if self._moving[i]:
                self.halt_motors(i)
            return
        self._moving[i] = True
        self.world.safe[i] = 0
        self.world.safe_us[i] = -1
        body.actuate(self.world, i, row(command), len(command))

    def halt_motors(self, i: int) -> None:
        """Stop robot i's motors, because its trusted nodes sent a stop or have gone."""
        self._moving[i] = False
        self.world.safe[i] = 1
        self.world.safe_us[i] = self.world.clock[0].now_us
        body.halt(self.world, i)

    def cut(self, first: int) -> None:
        """Block packets between the first `first` robots and the others from now on."""
        self.world.reach.aisle[:first] = 1
        self.world.reach.aisle[first:] = 2

    def record_state(self, i: int, state: Mapping[str, Any], began_s: float) -> None:
        """Store the state that robot i published (state.py); `began_s` is its mission's start in the field's time."""
        self._states[i] = {**state, "began_s": began_s}
        self.world.fleet.robot[i].log_max = state["log_bytes_max"]
        liar = self.robots.get(i)
        if isinstance(liar, Liar) and state["first_deviation_s"] is not None:
            boot_ms = int(self.world.boot_us[i]) // 1000
            liar.first_deviation_ms = boot_ms + round(1000 * (began_s + state["first_deviation_s"]))

    def shields(self) -> list[list[tuple[int, float]]]:
        """See `Run`; from the states that the robots published last."""
        states = [self._states.get(i) for i in range(len(self.ids))]
        return [
            [(each["auditor"], each["left_s"]) for each in state["tokens"]] if state and not state["safe_mode"] else []
            for state in states
        ]

    def new_verdicts(self) -> list[tuple[float, int, int, Refusal]]:
        """Return no verdicts, because robot processes do not publish theirs; see `Run`."""
        return []

    def summary(self) -> dict[str, Any]:
        """See `Run`. Real-time runs differ, so there is no digest."""
        summary = super().summary() | {"digest": None, "processes": [self._process(i) for i in range(len(self.ids))]}
        # Wheeled robots have no goal, and their bodies none of the sizes that define contacts.
        if self.scenario.controller == WHEELS:
            summary |= {"contacts": None, "mean_distance_to_goal_m": None, "distance_series": []}
        for name in ("correct_in_safe_mode", "without_quorum"):
            summary[name] = [each for each in summary[name] if each not in self._on_air]
        summary["on_air"] = []
        for rob_id, name in sorted(self._on_air.items()):
            safe_us = int(self.world.safe_us[rob_id - 1])
            ended = None if safe_us < 0 else safe_us / 1e6
            summary["on_air"].append({"robot": rob_id, "attack": name, "safe_mode_s": ended})
        return summary

    def fail(self, rob_id: int, how: str, at_s: float) -> None:
        """Record that the process of a robot ended too early; from then on it does not count as correct."""
        if rob_id not in self.failed:
            self.failed[rob_id] = how, at_s
            self._gone[rob_id - 1] = True
            self._quorum.lose(rob_id - 1)

    @property
    def _correct(self) -> NDArray[np.bool_]:
        correct: NDArray[np.bool_] = super()._correct & ~self._gone
        return correct

    def _process(self, i: int) -> dict[str, Any]:
        how, at_s = self.failed.get(i + 1, (None, None))
        state, failed = self._states.get(i), {"failed_s": at_s, "failed": how}
        if state is None:
            return {"robot": i + 1} | failed
        names = (
            "pid",
            "lived_s",
            "tokens_got",
            "refused",
            "cpu_share",
            "advice",
            "longest_ms",
            "why_late",
            "frames_refused",
            "memory_kb",
            "memory_began_kb",
        )
        return {"robot": i + 1} | failed | {name: state[name] for name in names}
