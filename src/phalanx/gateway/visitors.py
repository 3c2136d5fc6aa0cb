"""Who visits, and who drives. In mode qrkey nobody proves who they are: these are the ids that visitors say."""

from __future__ import annotations

import hmac
import os
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

FORGET_AFTER_S = 150.0  # published pages ask when they are told to reload
NOTIFIED_FOR_S = 600.0
LIMIT = 1000
DRIVES_FOR_S = 0.5  # a joystick speaks ten times a second
MOST_DRIVERS = 4  # of a robot: a visitor may invent names without end, and all must fit an update
OURS = re.compile("phalanx_[0-9a-f]{16}")
SHOWN = 6


@dataclass(slots=True)
class Visitor:
    """One client id."""

    client_id: str
    seen_at_s: float
    requests: int = 0


class Visitors:
    """The visitors of late."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str, Visitor] = OrderedDict()
        self._until_s = 0.0
        self._secret = os.urandom(16)

    def shown(self, client_id: str) -> str:
        """What the operator's page calls a visitor: too little to ask for its answers, for whoever reads it there.

        Of ours the end, by which it is named where it drives too: forty bits more have to be guessed. Published clients
        have short ones, and are shown by another name.
        """
        if OURS.fullmatch(client_id):
            return f"phalanx…{client_id[-SHOWN:]}"
        return f"visitor {hmac.new(self._secret, client_id.encode(), 'sha256').hexdigest()[:SHOWN]}"

    def asked(self, client_id: str, uptime_s: float) -> None:
        """A request was heard."""
        visitor = self._seen.pop(client_id, None) or Visitor(client_id, uptime_s)
        visitor.seen_at_s = uptime_s
        visitor.requests += 1
        self._seen[client_id] = visitor
        if len(self._seen) > LIMIT:  # a visitor may invent ids without end
            self._seen.popitem(last=False)
        self._until_s = uptime_s + NOTIFIED_FOR_S

    def present(self, uptime_s: float) -> list[Visitor]:
        """Those seen lately, the latest first."""
        for gone in [v.client_id for v in self._seen.values() if v.seen_at_s + FORGET_AFTER_S < uptime_s]:
            del self._seen[gone]
        return list(reversed(self._seen.values()))

    def are_there(self, uptime_s: float) -> bool:
        """Return whether notifications are worth sending."""
        return uptime_s < self._until_s


class Drivers:
    """Keep who drives which robot, so that everybody sees it, and two who share one know why it does not obey.

    Args:
        assigned: returns the names of those who have robots by their sessions, by address; others drive by joystick.
    """

    def __init__(self, assigned: Callable[[], Mapping[str, str]] = dict) -> None:
        self._assigned = assigned
        self._until: dict[str, dict[str, float]] = {}
        self._told: dict[str, list[str]] = {}

    def drives(self, address: str, by: str, uptime_s: float) -> None:
        """A joystick's command was heard; `by` is a nickname, or "" in mode qrkey."""
        drivers = self._until.setdefault(address, {})
        if by in drivers or len(drivers) < MOST_DRIVERS:
            drivers[by] = uptime_s + DRIVES_FOR_S

    def news(self, number: Callable[[str], int], uptime_s: float) -> dict[str, list[Any]]:
        """`drivers` of the next frame: of each robot for which they changed."""
        now = {a: {by: until for by, until in who.items() if until > uptime_s} for a, who in self._until.items()}
        self._until = {address: who for address, who in now.items() if who}
        before, self._told = self._told, {address: sorted(who) for address, who in self._until.items()}
        for address, name in self._assigned().items():
            others = [by for by in self._told.get(address, ()) if by != name]
            self._told[address] = [name, *others][:MOST_DRIVERS]
        changed = [a for a, who in self._told.items() if who != before.get(a)]
        changed += [a for a in before if a not in self._told]
        return {"drivers": [[number(address), self._told.get(address, [])] for address in changed]}

    def in_list(self) -> dict[str, dict[str, Any]]:
        """Return what an answer to request 0 says of each robot beside the rest, by address: as frames said it."""
        return {address: {"drivers": who} for address, who in self._told.items()}
