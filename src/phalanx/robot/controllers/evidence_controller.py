"""A controller that also sees what no chain holds: what it asks of whoever runs it, and nothing of missions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable

from .python_controller import Controller, Output


class EvidenceController(Controller, ABC):
    """A controller some of whose decisions rest on readings that no chain holds.

    `on_evidence` is what is replayed; `on_input` is the same where nothing was kept.
    """

    @abstractmethod
    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """The robot itself, before `on_evidence`: what to keep of `raw`, whose hash is in `reading`; b"" for nothing.

        Secrets and searches belong here. Nobody replays it.
        """

    @abstractmethod
    def on_evidence(self, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Output]:
        """As `on_input`, with what was kept. Raises: PeerError: the evidence does not bear out what it is for."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """The sensors said something of which nothing was kept."""
        return self.on_evidence(step, t_ms, reading, b"")
