"""Find attacks by name. What stands below `phalanx.attacks` knows them by this registry alone.

Packages add attacks by an entry point of the group `phalanx.attacks`, as this one does (pyproject.toml): a mapping from
names to records.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType

from .attack import Attack

GROUP = "phalanx.attacks"


@cache
def attacks() -> Mapping[str, Attack]:
    """Return all registered attacks, by name; load them at the first call."""
    return MappingProxyType({name: each for point in entry_points(group=GROUP) for name, each in point.load().items()})


@cache
def swarm_attacks() -> Mapping[str, Attack]:
    """Return the attacks that a robot of a swarm carries out, by name."""
    return MappingProxyType({name: each for name, each in attacks().items() if each.in_swarm})
