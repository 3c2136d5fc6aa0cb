"""Active visitors and drivers. In mode qrkey identities are unproven: the ids are those that clients send."""

from __future__ import annotations

import hmac
import os
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

FORGET_AFTER_S = 150.0  # published pages send requests after each reload notification
NOTIFIED_FOR_S = 600.0
LIMIT = 1000
DRIVES_FOR_S = 0.5  # a joystick sends ten commands a second
MOST_DRIVERS = 4  # per robot: visitors can invent names, and all must fit an update
OURS = re.compile("phalanx_[0-9a-f]{16}")
SHOWN = 6


@dataclass(slots=True)
class Visitor:
    """One client id."""

    client_id: str
    seen_at_s: float
    requests: int = 0


class Visitors:
    """Recently active visitors."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str, Visitor] = OrderedDict()
        self._until_s = 0.0
        self._secret = os.urandom(16)

    def shown(self, client_id: str) -> str:
        """Return the name of a visitor on the operator's page, which must not reveal the client id.

        Of our ids the last characters are shown, which leaves forty bits to guess. Published clients have short ids, so
        they are shown under another name.
        """
        if OURS.fullmatch(client_id):
            return f"phalanx…{client_id[-SHOWN:]}"
        return f"visitor {hmac.new(self._secret, client_id.encode(), 'sha256').hexdigest()[:SHOWN]}"

    def asked(self, client_id: str, uptime_s: float) -> None:
        """Record a request."""
        visitor = self._seen.pop(client_id, None) or Visitor(client_id, uptime_s)
        visitor.seen_at_s = uptime_s
        visitor.requests += 1
        self._seen[client_id] = visitor
        if len(self._seen) > LIMIT:  # visitors can invent ids
            self._seen.popitem(last=False)
        self._until_s = uptime_s + NOTIFIED_FOR_S

    def present(self, uptime_s: float) -> list[Visitor]:
        """Return recently active visitors, latest first."""
        for gone in [v.client_id for v in self._seen.values() if v.seen_at_s + FORGET_AFTER_S < uptime_s]:
            del self._seen[gone]
        return list(reversed(self._seen.values()))

    def are_there(self, uptime_s: float) -> bool:
        """Return whether notifications are worth sending."""
        return uptime_s < self._until_s


class Drivers:
    """Names of those who drive each robot, for all pages: two who share a robot see why it does not obey.

    Args:
        assigned: returns the names of visitors who have robots by their sessions, by address; others use joysticks.
    """

    def __init__(self, assigned: Callable[[], Mapping[str, str]] = dict) -> None:
        self._assigned = assigned
        self._until: dict[str, dict[str, float]] = {}
        self._told: dict[str, list[str]] = {}

    def drives(self, address: str, by: str, uptime_s: float) -> None:
        """Record a joystick command; `by` is a nickname, or "" in mode qrkey."""
        drivers = self._until.setdefault(address, {})
        if by in drivers or len(drivers) < MOST_DRIVERS:
            drivers[by] = uptime_s + DRIVES_FOR_S

    def news(self, number: Callable[[str], int], uptime_s: float) -> dict[str, list[Any]]:
        """Return `drivers` of the next update: the robots whose drivers changed."""
        now = {a: {by: until for by, until in names.items() if until > uptime_s} for a, names in self._until.items()}
        self._until = {address: names for address, names in now.items() if names}
        before, self._told = self._told, {address: sorted(names) for address, names in self._until.items()}
        for address, name in self._assigned().items():
            others = [by for by in self._told.get(address, ()) if by != name]
            self._told[address] = [name, *others][:MOST_DRIVERS]
        changed = [a for a, names in self._told.items() if names != before.get(a)]
        changed += [a for a in before if a not in self._told]
        return {"drivers": [[number(address), self._told.get(address, [])] for address in changed]}

    def in_list(self) -> dict[str, dict[str, Any]]:
        """Return the drivers in answers to request 0, by address, as in the last update."""
        return {address: {"drivers": names} for address, names in self._told.items()}
