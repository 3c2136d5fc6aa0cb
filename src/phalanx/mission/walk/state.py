"""What a walk remembers: as much as whoever replays it must know, and beside it the robot's own keyring."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from .keyring import Keyring
from .opening import Known
from .table import Phase

_NOTHING: Mapping[int, Known] = MappingProxyType({})
_NO_LENGTHS: Mapping[tuple[int, int], float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class State:
    """All that a walk remembers. `State()` is its beginning."""

    phase: Phase = Phase.SEEKING
    at: int | None = None  # the last validated node
    target: int | None = None  # the one to be validated next
    t_s: float = -math.inf  # of the last step
    since_s: float | None = None  # nothing was validated
    fixed_at_m: float = 0.0  # way travelled at the last fix
    left_at_m: float = 0.0  # way travelled when `at` was validated
    # By how much landmarks seen again have moved the estimate since then, in all
    pulled_m: tuple[float, float] = (0.0, 0.0)
    opened: Mapping[int, Known] = field(default_factory=lambda: _NOTHING)
    lengths_m: Mapping[tuple[int, int], float] = field(default_factory=lambda: _NO_LENGTHS)
    blocked: frozenset[tuple[int, int]] = frozenset()  # ways that timed out or were blocked
    round: int = 0  # how often those were taken up again since a new node was decoded
    others: frozenset[int] = frozenset()  # nodes that other robots proved to have decoded
    heard: tuple[bytes, ...] = ()
    keys: Keyring = field(default_factory=Keyring)  # the robot's secrets; not in any encoding of the state
