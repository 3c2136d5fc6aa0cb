"""What a protected swarm shows beside robots: who vouches for whom, how audits end, who was stopped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from .swarm import Routed, Swarm


@dataclass(frozen=True, slots=True, kw_only=True)
class Shield:
    """One robot's shield at one moment."""

    address: str
    needed: int  # f_max + 1, fresh tokens that keep it alive
    full_s: float  # T_val, how long a token counts
    vouchers: tuple[tuple[str, float], ...]  # addresses, each with the seconds for which it still counts, longest first
    safe_mode: bool  # it has been stopped
    attack: str  # name of the one it runs, as the operator chose it; "" for an honest robot. Visitors are not told


@dataclass(frozen=True, slots=True, kw_only=True)
class Audit:
    """An audit that has ended, and between whom, by address."""

    auditor: str
    auditee: str
    refusal: str  # why no token was issued, in words; "" if one was


@dataclass(frozen=True, slots=True)
class AttackChoice:
    """An attack that an operator can have a robot run: its name, and what it does."""

    name: str
    does: str


@runtime_checkable
class Shielded(Routed, Protocol):
    """A swarm whose robots audit each other; their orders are logged, and sent by radio."""

    def shields(self) -> Sequence[Shield]:
        """One for every robot."""

    def new_audits(self) -> Sequence[Audit]:
        """Those that ended since the last call, oldest first."""

    def attacks(self) -> Sequence[AttackChoice]:
        """What a robot can be made to do."""

    def compromise(self, address: str, attack: str) -> None:
        """The robot lies from now on.

        Raises: Unknown: no such robot, or no such attack; or it is compromised or stopped already.
        """


@runtime_checkable
class Unprotected(Swarm, Protocol):
    """A swarm whose robots do not audit each other, though people may expect it."""

    @property
    def unprotected(self) -> str:
        """Why not, for people; "" where nobody expects it."""
