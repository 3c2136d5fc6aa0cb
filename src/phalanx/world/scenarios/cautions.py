"""Warn before a run about settings of a scenario with which audits are likely to fail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.nodes import limits_of
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited.setup import audits_share, make_lists
from phalanx.world.radio.reach import in_range, rebuild, set_aisles

# Share of the channel. In one radio range audits work up to 0.6, but 324 robots at 20 m (0.46) lost some after 40 s.
MOST_AUDITS = 0.45
# The same if f_max compromised robots fill their logs: at 0.40 they stopped correct robots, at 0.31 none
# (docs/results.md).
MOST_FILLED = 0.35
# Airtime that the AUDIT buckets of f_max compromised robots allow: at half of the channel they stopped correct robots
# (docs/promises.md, exception 12).
MOST_BUCKETS = 0.25
# With 9 and more, compromised robots stopped correct ones (docs/promises.md, exceptions 6 and 7).
MOST_F_MAX = 8
US_PER_S = 1e6


def audit_warnings(scenario: Scenario) -> list[str]:
    """Return a line for each reason why audits may fail: channel, T_val, robots in range, or compromised robots."""
    if scenario.defence == "none":
        return []
    near = _in_range_at_start(scenario)
    found = [*_crowded(scenario), *_seldom(scenario), *_lonely(scenario, near), *_many(scenario, near)]
    return [*found, *_flooded(scenario), *_overrun(scenario)]


def _overrun(scenario: Scenario) -> list[str]:
    liars, f_max = len(scenario.attacks), scenario.bti.f_max
    if liars > f_max:
        many = f"{liars} compromised robots, f_max is {f_max}"
        return [f"{many}: nothing is promised; use f_max {liars} or fewer attacks"]
    if f_max > MOST_F_MAX:
        return [f"f_max is {f_max}: above {MOST_F_MAX} compromised robots can stop correct ones; use a smaller f_max"]
    return []


def _many(scenario: Scenario, near: Sequence[NDArray[np.int32]]) -> list[str]:
    others = [len(each) for each in near]
    n_max, most = scenario.bti.n_max, max(others)
    if most <= n_max:
        return []
    robot = others.index(most) + 1
    return [
        f"robot {robot} has {most} others in range at the start, n_max is {n_max}: it may be stopped; use n_max {most}"
    ]


def _flooded(scenario: Scenario) -> list[str]:
    bti = scenario.bti
    share = bti.f_max * limits_of(bti, scenario.radio).audit_us_per_s / US_PER_S
    if scenario.defence != "hardened" or share < MOST_BUCKETS:
        return []
    lets = f"with n_max {bti.n_max} the a-nodes of f_max compromised robots allow audit packets for {share:.0%}"
    return [
        f"{lets} of the channel; above {MOST_BUCKETS:.0%} correct robots may be stopped; use a smaller n_max or f_max"
    ]


def _seldom(scenario: Scenario) -> list[str]:
    bti = scenario.bti
    # The first round starts up to T_audit + 0.2 s after the key; the second needs time for silent auditors.
    least_ms = max(5 * bti.t_audit_ms // 2, 2 * bti.t_audit_ms + 1000)
    if bti.t_val_ms >= least_ms:
        return []
    lasts = f"tokens last {bti.t_val_ms / 1000:g} s and a round of audits comes every {bti.t_audit_ms / 1000:g} s"
    return [f"{lasts}: one failed round may stop a correct robot; use t_val of at least {least_ms / 1000:g} s"]


def _crowded(scenario: Scenario) -> list[str]:
    robots = f"{scenario.robots_in_range:.0f} robots in one radio range"
    share = audits_share(scenario.bti, scenario.radio, scenario.robots_in_range)
    if share > MOST_AUDITS:
        need = f"{robots}: their audits need {share:.0%} of the channel"
        return [f"{need}, and above {MOST_AUDITS:.0%} robots may be stopped for lack of a quorum"]
    filled = audits_share(scenario.bti, scenario.radio, scenario.robots_in_range, filled=True)
    if filled <= MOST_FILLED:
        return []
    need = f"{robots}: if f_max compromised robots fill their logs, audits need {filled:.0%} of the channel"
    return [f"{need}, and above {MOST_FILLED:.0%} correct robots may be stopped; use a smaller f_max or fewer robots"]


def _lonely(scenario: Scenario, near: Sequence[NDArray[np.int32]]) -> list[str]:
    bti, is_correct = scenario.bti, np.ones(scenario.robots, bool)
    is_correct[[int(attack.robot or 0) - 1 for attack in scenario.drawn_attacks()]] = False
    others, correct_others = np.array([len(each) for each in near]), np.array([is_correct[each].sum() for each in near])
    correct, lonely = int(is_correct.sum()), int((is_correct & (correct_others < bti.quorum)).sum())
    if lonely == 0:
        return []
    of = "robots" if correct == scenario.robots else "correct robots"
    robots = f"none of the {of} has" if lonely == correct else f"{lonely} of {correct} {of} do not have"
    quorum = f"a quorum at the start, {bti.quorum} correct others (f_max + 2) within {scenario.radio.range_m:.0f} m"
    ends = "compromised robots can cause them to be stopped"
    if (others[is_correct] < bti.tokens_needed).any():
        ends = f"with fewer than {bti.tokens_needed} a robot is stopped after {bti.t_val_ms / 1000:g} s"
    return [f"{robots} {quorum}: {ends}; use more robots, a closer grid or a smaller f_max"]


def neighbours_at_start(scenario: Scenario) -> NDArray[np.int64]:
    """Return the number of other robots in range of each robot at the start, (N,)."""
    return np.array([len(each) for each in _in_range_at_start(scenario)], np.int64)


def _in_range_at_start(scenario: Scenario) -> list[NDArray[np.int32]]:
    """Return the indices of the robots in range of each robot at the start."""
    reach = make_lists(scenario.robots, scenario.bti, scenario.radio, skin=0.0)
    rebuild(reach, np.array(scenario.starts_m, np.float64))
    if scenario.hub:
        set_aisles(reach, scenario.hub, scenario.robots)
    ends = [in_range(reach, i) for i in range(scenario.robots)]
    return [reach.ids[reach.near[i] : end] for i, end in enumerate(ends)]
