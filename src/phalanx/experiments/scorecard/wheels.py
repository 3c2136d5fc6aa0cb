"""An attack on the demo's robots: on wheels, driven by orders, beside the same drive in which nobody lies.

They do not make way for each other, so that damage is how often robots touch.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from phalanx.config.defence import Defence
from phalanx.errors import UsageError
from phalanx.experiments.bti.attack_trial import Stop
from phalanx.robot import Point
from phalanx.robot.attacks.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.sim.audited.world import clock_ms
from phalanx.sim.radio.channel import AUDIT_BROADCAST, BYTES
from phalanx.sim.swarms.protected import DEMO, EDGE_MM, ProtectedSwarm

from .plan import HONEST_KEPT

ROBOTS = 12
STEP_S, ORDERS_S = 0.05, 5.0  # each robot is sent somewhere else so often
NEAR_MM = 60.0


def drive(defence: Defence, seed: int, seconds: float, spec: AttackSpec | None = None) -> ProtectedSwarm:
    """The swarm after so many seconds; one that the seed chooses lies as `spec` says, if there is one."""
    swarm = ProtectedSwarm(ROBOTS, seed, lambda: 0.0, defence=defence)
    chance = np.random.default_rng([seed, 0x77686C])
    addresses = [robot.address for robot in swarm.robots()]
    liar = addresses[int(chance.integers(ROBOTS))]
    low, high = np.full(2, EDGE_MM), np.array(swarm.area_mm) - EDGE_MM
    for k in range(round(seconds / STEP_S)):
        if k % round(ORDERS_S / STEP_S) == 0:
            for address in addresses:
                swarm.follow(address, [Point(*chance.uniform(low, high).tolist())], NEAR_MM)
        if spec and k == round(spec.at_s / STEP_S):
            swarm.compromise(liar, spec.name)
        swarm.step(STEP_S)
    return swarm


@lru_cache(HONEST_KEPT)
def _honest(defence: Defence, seed: int, seconds: float) -> ProtectedSwarm:
    return drive(defence, seed, seconds)


def try_on_wheels(spec: AttackSpec, defence: Defence, seed: int, seconds: float) -> dict[str, Any]:
    """What a row of the scorecard says of it."""
    if spec.at_s >= seconds:
        raise UsageError(f"{spec.name} begins at {spec.at_s:g} s, when the run is over", f"before {seconds:g} s")
    swarm, honest = drive(defence, seed, seconds, spec), _honest(defence, seed, seconds)
    ((i, liar),) = swarm.liars.items()
    assert isinstance(liar, Liar), "who was compromised lies"
    world = swarm.world
    boot_ms, safe_us = int(world.boot_us[i]) // 1000, int(world.safe_us[i])
    promised = defence != "none" and spec.attack.verdicts[defence] == "stopped"
    bound_s = DEMO.stop_bound_ms(output_missing=liar.output_missing) / 1000 if promised else None
    began_s = None if liar.first_deviation_ms is None else (liar.first_deviation_ms - boot_ms) / 1000
    stop = Stop(i + 1, began_s, None if safe_us < 0 else safe_us / 1e6, liar.output_missing)
    in_time = stop.is_in_time(bound_s, (clock_ms(world, i) - boot_ms) / 1000)
    wronged = int(world.safe[:ROBOTS].sum()) - int(world.safe[i])
    rates = honest.world.air.counts[:ROBOTS, AUDIT_BROADCAST : AUDIT_BROADCAST + 2, BYTES]
    return {
        "harm": float(max(0, int(world.clock[0].contacts) - int(honest.world.clock[0].contacts))),
        "harm_unit": "contacts",
        "bites_from": 1.0,
        "liars": 1,
        "deviated": int(began_s is not None),
        "stopped": int(stop.after_s is not None),
        "slowest_stop_s": stop.after_s,
        "bound_s": bound_s,
        "correct_stopped": wronged,
        "missed": {"stopped too late": not in_time, "correct robots stopped": promised and wronged > 0},
        "audit_bytes_per_s": float(rates.sum()) / ROBOTS / seconds,
    }
