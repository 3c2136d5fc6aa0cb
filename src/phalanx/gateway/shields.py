"""State of the shields for pages: who vouches for whom, results of audits, stopped robots.

Visitors receive all of it, except which robot the operator has compromised: only `state` and `say` contain that.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from phalanx.errors import Unknown, UsageError
from phalanx.robot import Swarm
from phalanx.robot.on_mission import OnMission
from phalanx.robot.swarm import Audit, AuditedSwarm, Revivable, Shield

LOOK_EVERY_S = 0.3
# Pages count down tokens themselves; only larger differences are sent again.
SAME_WITHIN_S = 0.5
# Per tick; a hundred honest robots complete about ten. Refusals come first.
MOST_AUDITS = 64
REFUSALS_KEPT = 50
BY_HAND = (
    "a real robot is revived by hand only, with a new mission key",
    "switch it off, find out why it was stopped, and load the next mission's key into all: phalanx docs guides/robot",
)
NOT_ON_MISSION = ("robots on a mission cannot be revived", "send them another mission, or restart the gateway")


def check_revivable(swarm: Swarm) -> Revivable:
    """Return the swarm if its stopped robots can be restarted. Raises: UsageError: they cannot."""
    if not isinstance(swarm, Revivable):
        raise UsageError(*(NOT_ON_MISSION if isinstance(swarm, OnMission) else BY_HAND))
    return swarm


@dataclass(slots=True)
class _Lie:
    """When the operator compromised a robot, and when it was stopped; monotonic seconds."""

    since_s: float
    stopped_at_s: float | None = None


class ShieldWatch:
    """Compares shields with those last sent to visitors. `say` receives events for `--events`."""

    def __init__(self, swarm: AuditedSwarm, say: Callable[[dict[str, Any]], None]) -> None:
        self._swarm = swarm
        self._say = say
        self._checks_tokens = not getattr(swarm, "unchecked", "")  # read once: the attribute changes if the nodes fail
        self._told: dict[str, tuple[bool, dict[str, float]]] = {}
        self._refused: deque[tuple[float, Audit]] = deque(maxlen=REFUSALS_KEPT)
        self._last: dict[str, Audit] = {}
        self._lies: dict[str, _Lie] = {}
        self._stopped_at_s: dict[str, float] = {}
        self._look_at_s = 0.0
        self._terms: dict[str, int] = {}

    def news(self, number: Callable[[str], int], uptime_s: float) -> dict[str, list[Any]]:
        """Return `shields` and `audits` of the next update; `number` numbers robots, `uptime_s` is monotonic."""
        audits = list(self._swarm.new_audits())
        for audit in audits:
            self._last[audit.auditee] = audit
            if audit.refusal:
                self._refused.append((uptime_s, audit))
                self._say(
                    {"event": "audit", "auditor": audit.auditor, "auditee": audit.auditee, "refusal": audit.refusal}
                )
        audits = sorted(audits, key=lambda audit: not audit.refusal)[:MOST_AUDITS]
        changed: list[Shield] = []
        # Every tick while a compromised robot runs: the operator sees how long it took to stop it.
        if uptime_s >= self._look_at_s or any(lie.stopped_at_s is None for lie in self._lies.values()):
            self._look_at_s = uptime_s + LOOK_EVERY_S
            changed = [shield for shield in self._swarm.shields() if self._is_news(shield, uptime_s)]
        return {
            "shields": [[number(shield.address), *_tell_shield(shield, number)] for shield in changed],
            "audits": [[number(audit.auditor), number(audit.auditee), audit.refusal] for audit in audits],
        }

    def _is_news(self, shield: Shield, uptime_s: float) -> bool:
        until = {auditor: uptime_s + left_s for auditor, left_s in shield.vouchers}
        was_safe, before = self._told.get(shield.address, (False, {}))
        if not shield.safe_mode:
            self._stopped_at_s.pop(shield.address, None)
        elif not was_safe:
            self._stopped_at_s[shield.address] = uptime_s
            self._say({"event": "safe_mode", "address": shield.address})
            if lie := self._lies.get(shield.address):
                lie.stopped_at_s = uptime_s
        same = shield.address in self._told and was_safe == shield.safe_mode and until.keys() == before.keys()
        if same and all(abs(until[auditor] - before[auditor]) <= SAME_WITHIN_S for auditor in until):
            return False
        self._told[shield.address] = shield.safe_mode, until
        return True

    def in_list(self, number: Callable[[str], int]) -> dict[str, dict[str, Any]]:
        """Return the shield's fields in answers to request 0, by address."""
        return {
            shield.address: {
                "shield": _tell_shield(shield, number),
                "audited": [number(last.auditor), last.refusal] if (last := self._last.get(shield.address)) else None,
            }
            for shield in self._swarm.shields()
        }

    def in_area(self) -> dict[str, int]:
        """Return the shields' fields in answers to request 1; {} for an empty swarm."""
        # Constant and equal for all robots. Cached, as there may be a thousand requests a second.
        if not self._terms and (shields := self._swarm.shields()):
            self._terms = {
                "tokens_needed": shields[0].needed,
                "t_val_ms": round(shields[0].full_s * 1000),
            }
        return self._terms

    def compromise(self, address: str, attack: str) -> None:
        """Compromise a robot. Raises: Unknown: no such robot or attack, or it is compromised or stopped."""
        self._swarm.compromise(address, attack)
        self._lies[address] = _Lie(time.monotonic())
        self._say({"event": "compromised", "address": address, "attack": attack})

    def revive(self, address: str) -> None:
        """Restart a stopped robot. Raises: Unknown: no such robot, or it runs; UsageError: it is a real one."""
        check_revivable(self._swarm).revive(address)
        self._lies.pop(address, None)
        self._say({"event": "revived", "address": address})

    def revive_after(self, stopped_s: float, uptime_s: float) -> None:
        """Revive all robots that have been stopped for `stopped_s`."""
        for address, since_s in list(self._stopped_at_s.items()):
            if uptime_s - since_s >= stopped_s:
                del self._stopped_at_s[address]
                with contextlib.suppress(Unknown):  # revived by hand meanwhile
                    self.revive(address)

    def health(self, uptime_s: float) -> str:
        """Return `working` if a robot that was not stopped has the tokens that it needs, otherwise `not working`.

        `none`: no trusted node here checks tokens, or robots wait for their first mission. Uses cached shields only.
        """
        if not self._checks_tokens or (isinstance(self._swarm, OnMission) and self._swarm.progress() is None):
            return "none"
        needed = self.in_area().get("tokens_needed", 0)
        works = any(
            not is_stopped and sum(until_s > uptime_s for until_s in until.values()) >= needed
            for is_stopped, until in self._told.values()
        )
        return "working" if works else "not working"

    def is_stopped(self, address: str) -> bool:
        """Return whether a robot is stopped."""
        return any(shield.safe_mode for shield in self._swarm.shields() if shield.address == address)

    def state(self, name: Callable[[str], str]) -> dict[str, Any]:
        """Return the data of the operator's page; `name` returns a robot's name."""
        shields, now_s = self._swarm.shields(), time.monotonic()
        return {
            **self.in_area(),
            "revives": isinstance(self._swarm, Revivable),
            "attacks": [{"name": attack.name, "does": attack.does} for attack in self._swarm.attacks()],
            "refusals": [
                {
                    "ago_s": round(now_s - at_s, 1),
                    "auditor": name(audit.auditor),
                    "auditee": name(audit.auditee),
                    "reason": audit.refusal,
                }
                for at_s, audit in reversed(self._refused)
            ],
            "robots": {
                shield.address: {
                    "safe_mode": shield.safe_mode,
                    "attack": shield.attack,
                    "lie": _tell_lie(self._lies.get(shield.address), now_s),
                    "vouchers": [{"name": name(a), "left_s": round(left_s, 1)} for a, left_s in shield.vouchers],
                }
                for shield in shields
            },
        }


def _tell_shield(shield: Shield, number: Callable[[str], int]) -> list[Any]:
    """Return `[safe mode, [[auditor, tenths of a second until its token expires], ...]]`."""
    return [int(shield.safe_mode), [[number(auditor), round(left_s * 10)] for auditor, left_s in shield.vouchers]]


def _tell_lie(lie: _Lie | None, now_s: float) -> dict[str, float | None] | None:
    if lie is None:
        return None
    took_s = None if lie.stopped_at_s is None else round(lie.stopped_at_s - lie.since_s, 1)
    return {"since_s": round(now_s - lie.since_s, 1), "stopped_after_s": took_s}
