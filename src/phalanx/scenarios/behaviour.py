"""Derive what the robots of a scenario run: controller, parameters, planner, and the adversary's plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.config.flock import NO_CROWD, WheelsConfig
from phalanx.config.guard import GuardConfig
from phalanx.errors import UsageError
from phalanx.robot.adversary.liar import Plan
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.declaration import OWN, Declaration
from phalanx.robot.controllers.protocol import Stage, find_protocol
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.planner import MakePlanner, ToGoal
from phalanx.wire.table import SENSOR

from .attack_spec import AttackSpec
from .scenario import Scenario

MakeController = Callable[[int], Controller]
# Stop time of an attack without an end.
FOREVER_MS = (1 << 32) - 1


def declaration_of(scenario: Scenario) -> Declaration:
    """Return the declaration of the scenario's controller; a protocol in Python has that of the flock controller."""
    return dispatch.BUNDLED.get(scenario.controller, dispatch.BUNDLED["flock"])


def params_of(scenario: Scenario, mission: int = 1) -> NDArray[np.float64]:
    """Return the parameters of the scenario's controller, the same for all robots.

    Args:
        mission: number of the mission's key.
    """
    bundled = declaration_of(scenario)
    if bundled.config is WheelsConfig:
        return bundled.params(
            WheelsConfig(
                state_every=scenario.bti.steps_per_state,
                mission=mission,
                looks=scenario.order_looks,
                gateway_key=bytes.fromhex(scenario.gateway_key),
                operator_key=bytes.fromhex(scenario.operator_key),
            )
        )
    if bundled.config is GuardConfig:
        return bundled.params(replace(scenario.guard, mission=mission))
    # With a longer T_val, false claims push a robot for longer: the limit shrinks, so that they push it no further
    # than within 10 s. Other defences have no limit.
    longer = max(1.0, scenario.bti.t_val_ms / BtiConfig().t_val_ms)
    crowd = scenario.flock.crowd / longer if scenario.defence == "hardened" else NO_CROWD
    return bundled.params(replace(scenario.flock, crowd=crowd))


def number_of(scenario: Scenario, controller: MakeController | None) -> int:
    """Return the number of the controller in `dispatch`; 0 for a user's Python class."""
    return 0 if controller else dispatch.NUMBERS[scenario.controller]


def with_room(scenario: Scenario, controller: MakeController | None) -> Scenario:
    """Return the scenario with `state_bytes` and `reading_bytes` large enough for a user's own controller."""
    senses = getattr(controller, "senses", None)
    is_own = controller is None and scenario.controller in OWN
    capacity = dispatch.capacity(number_of(scenario, None), params_of(scenario)) if is_own else 0
    sizes = {
        "state_bytes": max(getattr(controller, "state_bytes", 0), capacity),
        "reading_bytes": max(getattr(controller, "reading_bytes", 0), SENSOR.size + senses.size if senses else 0),
    }
    longest = {name: max(getattr(scenario.bti, name), size) for name, size in sizes.items()}
    return replace(scenario, bti=replace(scenario.bti, **longest))


def with_protocol(
    scenario: Scenario, controller: MakeController | None
) -> tuple[Scenario, MakeController | None, Stage | None]:
    """Return the scenario adapted to a protocol's readings and states, the protocol's controllers, and its stage.

    Without a protocol the scenario and the controller stay the same, and the stage is None.
    """
    protocol = find_protocol(scenario.controller)
    if not protocol:
        return scenario, controller, None
    task, make = scenario.task, protocol.maker(scenario.task)
    sizes = {"state_bytes": len(make(1).encode()), "reading_bytes": SENSOR.size + protocol.stage.seen_bytes}
    scenario = replace(scenario, bti=replace(scenario.bti, **sizes))
    return scenario, controller or make, protocol.stage(task)


def planner_factory(
    scenario: Scenario, controller: MakeController | None, planner: MakePlanner | None = None
) -> MakePlanner | None:
    """Return the factory of the robots' planners, None if their controller is not the guard.

    Raises: UsageError: a planner without the guard.
    """
    advised = declaration_of(scenario).advised is not None and controller is None
    if planner and not advised:
        raise UsageError("a planner, but no controller that takes its advice", "use a scenario with controller: guard")
    return planner or ToGoal if advised else None


def plan_of(scenario: Scenario, spec: AttackSpec, boot_ms: int, chance: np.random.Generator) -> Plan:
    """Return the plan of attack `spec` for a robot whose clock showed `boot_ms` at the start of the run."""
    return Plan(
        ids=tuple(range(1, scenario.robots + 1)),
        goal_m=scenario.goal_m,
        colluding=tuple(int(each.robot or 0) for each in scenario.drawn_attacks() if each.robot != spec.robot),
        start_ms=boot_ms + round(spec.at_s * 1000),
        stop_ms=FOREVER_MS if spec.until_s is None else boot_ms + round(spec.until_s * 1000),
        chance=chance,
        options=spec.options,
    )
