"""Define the inputs of every oracle case. This file imports nothing of phalanx: `observe` maps its words to the code.

Change an existing case only together with its digests, and only when an issue asks for that change of behaviour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

DEFENCES = ("none", "paper", "hardened")
# An attack begins at ATTACK_S; the protocol stops the robot at most 10.3 s later.
ATTACK_S, ATTACKED_S = 8.0, 21
DEMO_ATTACK_S, DEMO_S = 5.0, 18
# All attacks of the library by the way each one is run. A test compares these names with the library.
FLOCK_ATTACKS = (
    "spoof masquerade false-state equivocate nan omit-sends hijack flee expel seize-orders drop-entries alter-entries "
    "reorder-entries insert-entries truncate-log forge-checkpoint swap-nodes stale-log interleave starve-sensors t-key "
    "refuse-audit refuse-to-audit forge-tokens share-tokens replay-tokens self-issue collude zero-key request-flood "
    "frame-flood talk-over talk-over-replies relay-hello mask covert-talk ghost-auditors log-flood long-frames slot-squat push-out stale-answers "
    "wrong-checkpoint drain nondeterministic crash stuck-sensor gps-spoof in-protocol jam"
).split()
PROTOCOL_ATTACKS = {
    "hog-cells": "warehouse",
    "claim-visits": "patrol",
    "claim-area": "exploration",
    "open-breach": "perimeter",
    "point-elsewhere": "tracking",
    "show-intruder": "perimeter",
    "show-target": "tracking",
}
ERRAND_ATTACKS = (
    "flip-bit forge-graph replay-day replay-robot replay-again set-clock swap-key spoof-scan drag-scan freeze-scan "
    "move-code clone-code nudge-code stale-message drown-message dead-wheel slip"
).split()
FILE_ATTACKS = "guess-graph guess-plan guess-gate guess-token".split()
TEAM_ATTACKS = "skip-node drive-dark show-unsensed forge-claim".split()
# Simulated seconds of the bundled scenarios. The first three have liars from 15 s on.
SCENARIOS = {
    "bti-fig2": 27,
    "bti-fig8": 30,
    "bti-fig9": 30,
    "exploration": 25,
    "flock-12": 25,
    "grid-324": 12,
    "islands-24": 25,
    "line-25": 25,
    "patrol": 25,
    "perimeter": 25,
    "ring-25": 25,
    "star-25": 25,
    "tracking": 25,
    "warehouse": 25,
}
# The swarms of benchmarks/bench_bti.py: robots, grid step and spacing (m), f_max, simulated seconds here.
BENCHMARKS = (
    (25, 25.0, 20.0, 3, 48),
    (100, 4.0, 4.0, 3, 14),
    (324, 64.0, 64.0, 2, 14),
    (1000, 64.0, 64.0, 2, 14),
    (10_000, 64.0, 64.0, 2, 8),
    (60_000, 64.0, 64.0, 2, 5),
)
# The smallest runs that together touch each part of the simulator.
QUICK = frozenset(
    {
        "scenario/bti-fig9",
        "scenario/patrol",
        "attack/spoof/paper",
        "attack/request-flood/hardened",
        "mission/inspection/paper/none",
        "team/skip-node/hardened",
        "errand/flip-bit/hardened",
        "demo/hijack",
    }
)


@dataclass(frozen=True, slots=True)
class Case:
    """One recorded run: `observe.RUNNERS[runner]` runs it with `inputs`."""

    name: str
    runner: str
    inputs: dict[str, Any] = field(hash=False)

    @property
    def group(self) -> str:
        """Return the name of the file that holds its digests."""
        return self.name.partition("/")[0]

    @property
    def is_quick(self) -> bool:
        """Return whether the ordinary test run checks this case."""
        return self.name in QUICK


def _scenarios() -> Iterator[Case]:
    for name, duration_s in SCENARIOS.items():
        yield Case(f"scenario/{name}", "scenario", {"scenario": name, "duration_s": duration_s})
    for name in ("flock-12", "bti-fig9", "patrol", "tracking"):
        for defence in ("none", "paper"):
            inputs = {"scenario": name, "duration_s": 20, "defence": defence}
            yield Case(f"scenario/{name}/{defence}", "scenario", inputs)
    inputs = {"scenario": "flock-12", "duration_s": 15}
    yield Case("scenario/flock-12/seed-7", "scenario", {**inputs, "seed": 7})
    yield Case("scenario/flock-12/loss", "scenario", {**inputs, "radio": {"loss": 0.1}})
    yield Case("scenario/flock-12/guard", "scenario", {**inputs, "controller": "guard"})
    guarded = {**inputs, "controller": "guard", "planner": "examples/guarded.py:Ramming"}
    yield Case("scenario/flock-12/guard/ramming", "scenario", guarded)
    yield Case("scenario/flock-12/plain", "scenario", {**inputs, "plain": True})
    example = {"example": "examples/own_controller.py:GoThere", "duration_s": 25}
    yield Case("scenario/own-controller", "own", {**example, "attack": None})
    for defence in DEFENCES:
        inputs = {**example, "attack": "equivocate:robot=5,at=8", "defence": defence}
        yield Case(f"scenario/own-controller/equivocate/{defence}", "own", inputs)


def _attacks() -> Iterator[Case]:
    for name in FLOCK_ATTACKS:
        for defence in DEFENCES:
            inputs = {"attack": name, "at_s": ATTACK_S, "defence": defence, "duration_s": ATTACKED_S}
            yield Case(f"attack/{name}/{defence}", "attack", inputs)
    for name, scenario in PROTOCOL_ATTACKS.items():
        for defence in DEFENCES:
            inputs = {"attack": name, "at_s": ATTACK_S, "defence": defence, "duration_s": ATTACKED_S}
            yield Case(f"attack/{name}/{defence}", "attack", {"scenario": scenario, **inputs})


def _mission_attacks() -> Iterator[Case]:
    for defence in DEFENCES:
        yield Case(f"errand/honest/{defence}", "errand", {"attack": None, "defence": defence})
        yield from (
            Case(f"errand/{it}/{defence}", "errand", {"attack": it, "defence": defence}) for it in ERRAND_ATTACKS
        )
        yield from (Case(f"guess/{it}/{defence}", "guess", {"attack": it, "defence": defence}) for it in FILE_ATTACKS)
        yield from (Case(f"team/{it}/{defence}", "team", {"attack": it, "defence": defence}) for it in TEAM_ATTACKS)
    for name in ("flip-bit", "forge-graph", "replay-day", "replay-robot"):
        inputs = {"attack": name, "defence": "hardened", "unchecked": True}
        yield Case(f"errand/{name}/hardened/unchecked", "errand", inputs)


def _missions() -> Iterator[Case]:
    for mission in ("delivery", "inspection", "office"):
        for profile in ("paper", "sealed"):
            for defence in DEFENCES:
                robots = 2 if defence == "none" else 4
                inputs = {"mission": mission, "profile": profile, "defence": defence, "robots": robots}
                yield Case(f"mission/{mission}/{profile}/{defence}", "mission", {**inputs, "duration_s": 40})
    alone = {"mission": "office", "profile": "paper", "defence": "none", "robots": 1, "duration_s": 150}
    yield Case("mission/office/long", "mission", alone)
    yield Case("mission/office/people", "mission", {**alone, "duration_s": 60, "people": 10, "seed": 3})
    yield Case("mission/office/meet", "mission", {**alone, "duration_s": 60, "robots": 3, "meet_m": 6.0})
    delivery = {"mission": "delivery", "profile": "sealed", "defence": "none", "robots": 1, "duration_s": 200}
    yield Case("mission/delivery/long", "mission", delivery)
    crew = {
        "mission": "office",
        "defence": "hardened",
        "robots": 4,
        "attack": "drive-dark",
        "at_s": 10,
        "duration_s": 24,
    }
    yield Case("mission/office/crew", "crew", crew)
    audited = {"mission": "inspection", "profile": "sealed", "defence": "hardened", "robots": 4, "duration_s": 100}
    yield Case("mission/inspection/long", "mission", audited)


def _demo() -> Iterator[Case]:
    inputs = {"robots": 12, "duration_s": DEMO_S}
    yield Case("demo/honest", "demo", inputs)
    yield Case("demo/unprotected", "dotbots", inputs)
    for attack in ("hijack", "omit-sends", "seize-orders"):
        yield Case(f"demo/{attack}", "demo", {**inputs, "attack": attack, "at_s": DEMO_ATTACK_S})
    for protocol in ("patrol", "tracking"):
        yield Case(f"demo/{protocol}", "demo", {**inputs, "protocol": protocol})


def _benchmarks() -> Iterator[Case]:
    for robots, step_m, d_m, f_max, duration_s in BENCHMARKS:
        inputs = {"robots": robots, "grid_step_m": step_m, "d_m": d_m, "f_max": f_max, "duration_s": duration_s}
        yield Case(f"benchmark/{robots}", "benchmark", inputs)


def all_cases() -> dict[str, Case]:
    """Return every case by name, in the order in which they run."""
    groups = (_scenarios(), _attacks(), _mission_attacks(), _missions(), _demo(), _benchmarks())
    return {case.name: case for group in groups for case in group}
