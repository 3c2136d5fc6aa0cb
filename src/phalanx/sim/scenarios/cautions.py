"""What is said before a scenario runs that can hardly end well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.scenarios.scenario import Scenario
from phalanx.sim.audited.setup import audits_share, make_lists
from phalanx.sim.radio.reach import in_range, rebuild, set_aisles

# Of the channel. Where all hear each other it works up to 0.6, but 324 robots at 20 m (0.46) lost some after 40 s.
MOST_AUDITS = 0.45
# With logs that f_max liars fill: at 0.40 they stopped correct robots, at 0.31 none (docs/results.md).
MOST_FILLED = 0.35


def cautions(scenario: Scenario) -> list[str]:
    """One line each: the audits will saturate the channel, come too seldom, or robots have nobody to audit them."""
    if scenario.defence == "none":
        return []
    return [*_crowded(scenario), *_seldom(scenario), *_lonely(scenario)]


def _seldom(scenario: Scenario) -> list[str]:
    bti = scenario.bti
    # The first round begins up to T_audit + 0.2 s after the key; the second has to have time for silent auditors.
    least_ms = max(5 * bti.t_audit_ms // 2, 2 * bti.t_audit_ms + 1000)
    if bti.t_val_ms >= least_ms:
        return []
    lasts = f"tokens count for {bti.t_val_ms / 1000:g} s and a round of audits comes every {bti.t_audit_ms / 1000:g} s"
    return [f"{lasts}: one round that fails may stop a correct robot; t_val from {least_ms / 1000:g} s on bears one"]


def _crowded(scenario: Scenario) -> list[str]:
    robots = f"{scenario.robots_in_range:.0f} robots in one radio range"
    share = audits_share(scenario.bti, scenario.radio, scenario.robots_in_range)
    if share > MOST_AUDITS:
        want = f"{robots}: their audits want {share:.0%} of the channel"
        return [f"{want}, and above {MOST_AUDITS:.0%} robots may be stopped for want of a quorum"]
    filled = audits_share(scenario.bti, scenario.radio, scenario.robots_in_range, filled=True)
    if filled <= MOST_FILLED:
        return []
    want = f"{robots}: if f_max liars fill their logs, audits want {filled:.0%} of the channel"
    return [f"{want}, and above {MOST_FILLED:.0%} correct robots may be stopped; a smaller f_max or fewer robots help"]


def _lonely(scenario: Scenario) -> list[str]:
    bti, others = scenario.bti, neighbours_at_start(scenario)
    lonely = int((others < bti.quorum).sum())
    if lonely == 0:
        return []
    who = "none of the robots has" if lonely == scenario.robots else f"{lonely} of {scenario.robots} robots do not have"
    quorum = f"a quorum at the start, {bti.quorum} others (f_max + 2) within {scenario.radio.range_m:.0f} m"
    ends = "compromised robots may have them stopped"
    if (others < bti.tokens_needed).any():
        ends = f"with fewer than {bti.tokens_needed} a robot is stopped after {bti.t_val_ms / 1000:g} s"
    return [f"{who} {quorum}: {ends}; more robots, a closer grid or a smaller f_max help"]


def neighbours_at_start(scenario: Scenario) -> NDArray[np.int64]:
    """Return how many others each robot has in range when it starts, (N,)."""
    reach = make_lists(scenario.robots, scenario.bti, scenario.radio, skin=0.0)
    rebuild(reach, np.array(scenario.starts_m, np.float64))
    if scenario.hub:
        set_aisles(reach, scenario.hub, scenario.robots)
    ends: NDArray[np.int64] = np.array([in_range(reach, i) for i in range(scenario.robots)])
    return ends - reach.near[:-1]
