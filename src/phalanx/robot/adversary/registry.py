"""Registry of attacks by name; modules that `phalanx.attacks` imports find attacks only here.

Packages register attacks by an entry point of the group `phalanx.attacks`, a mapping from names to records. This
package does so in its pyproject.toml.
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
    """Return all registered attacks by name, loaded at the first call."""
    return MappingProxyType({name: each for point in entry_points(group=GROUP) for name, each in point.load().items()})


@cache
def swarm_attacks() -> Mapping[str, Attack]:
    """Return the attacks by robots of a swarm, by name."""
    return MappingProxyType({name: each for name, each in attacks().items() if each.in_swarm})
