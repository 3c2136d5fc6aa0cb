"""Why fewer robots vouch for this one than are needed, as far as its c-node knows: who refused it tells it nothing."""

from __future__ import annotations

from phalanx.bti.fleet import Fleet, vouchers
from phalanx.bti.rounds import HEARD_ROUNDS_X2


def why_stopped(fleet: Fleet, now_ms: int, late_ms: float) -> str:
    """For people, of the fleet's only robot, whose latest reading was so late."""
    s, robot = fleet.settings[0], fleet.robot[0]
    needed, window_ms = int(s.f_max) + 1, int(s.t_audit) * HEARD_ROUNDS_X2 // 2
    peers = fleet.peer[0, : int(robot.peers)]
    heard = peers["heard"] >= now_ms - window_ms
    asked = heard & (peers["asked_ms"] >= now_ms - int(s.t_val))
    what = f"{len(vouchers(fleet, 0, now_ms))} of the {needed} that are needed vouch for it"
    within = f"in the last {window_ms / 1000:g} s"
    if robot.log_full:
        return f"{what}; its log was full"
    if late_ms > s.delta:
        return f"{what}; a reading of its was {late_ms:.0f} ms late, and its auditors allow {int(s.delta)}"
    if heard.sum() < needed:
        return f"{what}; it heard {heard.sum()} robots {within}"
    return (
        f"{what}; it heard {heard.sum()} robots {within} and asked {asked.sum()} of them: "
        "who does not vouch refuses it, does not hear it, or has stopped"
    )
