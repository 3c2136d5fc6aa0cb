"""A controller that also reads data of which the chain holds a hash alone, as scans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable

from .python_controller import Controller, Output


class EvidenceController(Controller, ABC):
    """A controller some of whose decisions rest on data that no chain holds. Auditors replay `on_evidence`."""

    @abstractmethod
    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """Return what to keep of `raw`, whose hash is in `reading`; b"" for nothing.

        The robot itself calls this before `on_evidence`. Secrets and searches belong here: nobody replays it.
        """

    @abstractmethod
    def on_evidence(self, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Output]:
        """Decide as `on_input` does, with what was kept. Raises: PeerError: the evidence does not prove the reading."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """Decide on a reading of which nothing was kept."""
        return self.on_evidence(step, t_ms, reading, b"")
