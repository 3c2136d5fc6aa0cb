"""What one peer of a radio may say: as much as its a-node lets through, whatever its own radio would rather say."""

from __future__ import annotations

from phalanx.bti.nodes import limits_of
from phalanx.io.udp_radio import Allowance
from phalanx.scenarios.scenario import WHEELS, Scenario

LEAST_PER_S = 50.0  # a gateway speaks by its own pace, not by an a-node's buckets


def may_say(scenario: Scenario, peers: int, *, sealed: bool = False) -> Allowance:
    """Of each of so many addresses, behind which all other robots are: in an arena they share one.

    `sealed`: forgeries are refused by the a-node before they are logged, and must not use up their sender's share. Nor
    has a gateway that orders robots a share, as it speaks more than its a-node's buckets would let it. Then frames are
    counted alone.
    """
    limits = limits_of(scenario.bti, scenario.radio)
    behind = max(1, -(-(scenario.robots - 1) // max(1, peers)))
    # Twice: the network may say again what it carried.
    frames_per_s = 2 * (limits.send_us_per_s + limits.audit_us_per_s) / limits.airtime_fixed_us
    frames_per_s = behind * max(LEAST_PER_S, frames_per_s)
    if sealed or scenario.controller == WHEELS:
        return Allowance(frames_per_s)
    return Allowance(
        frames_per_s,
        behind * limits.send_us_per_s,
        behind * limits.send_capacity_us,
        limits.airtime_fixed_us,
        limits.airtime_ns_per_byte_broadcast,
    )
