"""Who visits. In mode qrkey nobody proves who they are: these are the client ids that asked something lately."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

FORGET_AFTER_S = 150.0  # pages ask at least once a minute
OLDER_PAGES_FOR_S = 600.0
LIMIT = 1000


@dataclass(slots=True)
class Visitor:
    """One client id."""

    client_id: str
    seen_at_s: float
    requests: int = 0


class Visitors:
    """The visitors of late, and whether one of them reads PyDotBot's older notifications."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str, Visitor] = OrderedDict()
        self._older_until_s = 0.0

    def asked(self, client_id: str, reads_frames: bool, uptime_s: float) -> None:
        """A request was heard."""
        visitor = self._seen.pop(client_id, None) or Visitor(client_id, uptime_s)
        visitor.seen_at_s = uptime_s
        visitor.requests += 1
        self._seen[client_id] = visitor
        if len(self._seen) > LIMIT:  # a visitor may invent ids without end
            self._seen.popitem(last=False)
        if not reads_frames:
            self._older_until_s = uptime_s + OLDER_PAGES_FOR_S

    def present(self, uptime_s: float) -> list[Visitor]:
        """Those seen lately, the latest first."""
        while self._seen and next(iter(self._seen.values())).seen_at_s < uptime_s - FORGET_AFTER_S:
            self._seen.popitem(last=False)
        return list(reversed(self._seen.values()))

    def older_pages(self, uptime_s: float) -> bool:
        """Whether notifications 1, 2 and 4 are worth sending."""
        return uptime_s < self._older_until_s
