"""Simulated swarm as a PettingZoo environment: learnt or scripted policies control the robots.

The robots are not audited, because an auditor would have to repeat the policy's computation bit by bit. Compromised
robots of the scenario send them false states as in any other run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import Unavailable, UsageError
from phalanx.robot.controllers.python_controller import Controller
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.record import MalformedRecord
from phalanx.wire.typed_records import Command, Reading, State
from phalanx.world.scenarios.play import STEP_S
from phalanx.world.scenarios.run import Run

try:
    from gymnasium.spaces import Box
    from pettingzoo import ParallelEnv  # type: ignore[import-untyped]
except ImportError as error:
    raise Unavailable("PettingZoo is not installed", "pip install '.[pettingzoo]' in a clone") from error

Vector = NDArray[np.float32]
MOST_MPS2 = 5.0  # largest acceleration per axis, docs/spec/world.md
FORGET_MS = 5000  # age at which a neighbour's state is dropped
OWN, EACH = 4, 5


class _PolicyRobot(Controller):
    """Robot that executes the policy's last action, broadcasts its state, and stores its neighbours' states."""

    def __init__(self, rob_id: int, steps_per_state: int) -> None:
        super().__init__(rob_id)
        self.command = Command(0.0, 0.0)
        self.reading = Reading(0.0, 0.0, 0.0, 0.0)
        self.heard: dict[int, tuple[int, State]] = {}  # by robot: time of arrival, state
        self._steps_per_state = steps_per_state

    def encode(self) -> bytes:
        return b""

    def decode(self, encoding: bytes) -> None:
        raise MalformedRecord(
            f"{len(encoding)} bytes: robot {self.rob_id} is controlled by a policy, and has no checkpoint"
        )

    def on_state(self, t_ms: int, state: State) -> None:
        self.heard[state.id] = t_ms, state

    def on_reading(self, step: int, _t_ms: int, reading: Reading) -> list[Command | State]:
        self.reading = reading
        is_due = (step + self.rob_id) % self._steps_per_state == 0
        return [self.command, State(*_motion(reading))] if is_due else [self.command]


def _motion(at: Reading | State) -> tuple[float, float, float, float]:
    return at.x_m, at.y_m, at.vx_mps, at.vy_mps


class SwarmEnv(ParallelEnv[str, Vector, Vector]):  # type: ignore[misc]
    """PettingZoo environment of a scenario: its correct robots are the agents "robot_1" etc.; a step is 0.25 s.

    An observation is float32, (4 + 5 `heard`,). It begins with the vector to the goal (m, two) and the own velocity
    (m/s, two). Then follow the nearest robots whose states arrived in the last 5 s: of each 1.0, its position and its
    velocity, both relative to the own; zeros fill the rest. A compromised robot's state is false. An action is float32,
    (2,): the acceleration, m/s², clipped to -5 to 5. The reward is the distance gained towards the goal, in metres,
    less 1 for each robot in contact. All agents are truncated at the scenario's end.

    Args:
        scenario: a scenario, the name of a built-in one, or a YAML file; its defence is replaced by none.
        heard: number of robots in an observation.
    Raises: as `find_scenario`. UsageError: `heard` is less than 0.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "phalanx_swarm_v0", "render_modes": [], "is_parallelizable": True}

    def __init__(self, scenario: Scenario | str | Path = "flock-12", *, heard: int = 6) -> None:
        if heard < 0:
            raise UsageError(f"heard is {heard}", "use 0 or more")
        chosen = scenario if isinstance(scenario, Scenario) else find_scenario(str(scenario))
        self.scenario = replace(chosen, defence="none")
        self.render_mode = None
        self._heard = heard
        liars = {spec.robot for spec in self.scenario.drawn_attacks()}
        self._ids = {f"robot_{i}": i for i in range(1, self.scenario.robots + 1) if i not in liars}
        self.possible_agents = list(self._ids)
        self.agents: list[str] = []
        size = OWN + EACH * heard
        self.observation_spaces = {name: Box(-np.inf, np.inf, (size,), np.float32) for name in self._ids}
        self.action_spaces = {name: Box(-MOST_MPS2, MOST_MPS2, (2,), np.float32) for name in self._ids}
        self._controlled: dict[int, _PolicyRobot] = {}
        self.run: Run | None = None  # the current run, with positions, shields and summary

    def observation_space(self, agent: str) -> Box:
        """Return the agent's observation space, the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Return the agent's action space, the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: Mapping[str, Any] | None = None,  # noqa: ARG002 - part of PettingZoo's interface
    ) -> tuple[dict[str, Vector], dict[str, dict[str, Any]]]:
        """Restart the scenario with its seed or this one. The compromised robots stay the same.

        Returns: observations and infos by agent; an info has `time_s`.
        """
        scenario = self.scenario
        if seed is not None:
            scenario = replace(scenario, seed=seed % (1 << 32), attacks=scenario.drawn_attacks())
        self._controlled = {}
        self.run = Run(scenario, self._make)
        self.run.advance(2 * STEP_S)  # by then all robots have a sensor reading
        self.agents = list(self.possible_agents)
        return self._observed(), self._infos(self.run)

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Vector], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by 0.25 s with the given accelerations; an agent without an action keeps its last one.

        Returns: observations, rewards, terminated, truncated, infos, by agent.
        Raises: UsageError: an action is not two finite numbers, or reset() was not called.
        """
        if self.run is None:
            raise UsageError("step before reset", "call env.reset() first")
        for agent, action in actions.items():
            accel = np.asarray(action, np.float64)
            if agent not in self._ids or accel.shape != (2,) or not np.isfinite(accel).all():
                raise UsageError(f"the action of {agent} is {action!r}", "give two finite numbers, for one of `agents`")
            ax_mps2, ay_mps2 = np.clip(accel, -MOST_MPS2, MOST_MPS2).tolist()
            self._controlled[self._ids[agent]].command = Command(ax_mps2, ay_mps2)
        run, before_m = self.run, self._to_goal_m(self.run.positions_m)
        run.advance(min(run.now_s + STEP_S, self.scenario.duration_s))
        nearer_m, touched = before_m - self._to_goal_m(run.positions_m), self._touched(run.positions_m)
        over = run.now_s >= self.scenario.duration_s
        at = {agent: self._ids[agent] - 1 for agent in self.agents}
        rewards = {agent: float(nearer_m[i] - touched[i]) for agent, i in at.items()}
        results = self._observed(), rewards, dict.fromkeys(at, False), dict.fromkeys(at, over), self._infos(run)
        if over:
            self.agents = []
        return results

    def close(self) -> None:
        """End the run; there are no resources to release."""
        self.run = None

    def _make(self, rob_id: int) -> _PolicyRobot:
        self._controlled[rob_id] = _PolicyRobot(rob_id, self.scenario.bti.steps_per_state)
        return self._controlled[rob_id]

    def _to_goal_m(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        distance: NDArray[np.float64] = np.hypot(*(at - np.array(self.scenario.goal_m)).T)
        return distance

    def _touched(self, at: NDArray[np.float64]) -> NDArray[np.int64]:
        apart_m = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
        touched: NDArray[np.int64] = (apart_m <= self.scenario.contact_m).sum(axis=1) - 1
        return touched

    def _infos(self, run: Run) -> dict[str, dict[str, Any]]:
        return {agent: {"time_s": run.now_s} for agent in self.agents}

    def _observed(self) -> dict[str, Vector]:
        return {agent: self._seen_by(self._controlled[self._ids[agent]]) for agent in self.agents}

    def _seen_by(self, robot: _PolicyRobot) -> Vector:
        seen = np.zeros(OWN + EACH * self._heard, np.float32)
        own = np.array(_motion(robot.reading))
        seen[:OWN] = [*(np.array(self.scenario.goal_m) - own[:2]), *own[2:]]
        others = [
            np.array(_motion(state)) - own
            for t_ms, state in robot.heard.values()
            if robot.reading.t - t_ms <= FORGET_MS
        ]
        for k, other in enumerate(sorted(others, key=lambda other: float(np.hypot(*other[:2])))[: self._heard]):
            seen[OWN + EACH * k : OWN + EACH * (k + 1)] = [1.0, *other]
        return seen
