"""What a swarm that has work of its own shows beside robots: what has come of it, and the things it is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from .swarm import Point, Swarm


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What has come of a swarm's work lately."""

    name: str  # of the work
    score: float | None  # None while there was nothing to count
    counts: str  # what the score counts, and its unit: "% watched"
    lately_s: float  # so far back it counts


@runtime_checkable
class AtWork(Swarm, Protocol):
    """A swarm that may have work of its own, which it does while nobody drives it."""

    def done(self) -> Done | None:
        """What has come of it, called about once a second; None where they wait for people."""

    def things(self) -> Sequence[Point]:
        """Where the things are now that the work is about, those in the area."""
