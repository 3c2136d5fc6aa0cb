"""What only the search needs, and stays with the robot: it is in no checkpoint, and no auditor asks for it.

A gate opens the way to the node behind it for whoever has a floor plan and patience. So the walk's state, which
auditors see, holds places and directions, and this holds the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from phalanx.mission.file.records import Header
from phalanx.mission.file.sealed import onward

from .gate import Gate
from .opening import Opened

_NO_GATES: Mapping[tuple[int, int], Gate] = MappingProxyType({})
_NO_PROOFS: Mapping[int, bytes] = MappingProxyType({})


@dataclass(frozen=True, slots=True, repr=False)
class Keyring:
    """Secrets of the nodes that were opened, and what was tried in vain."""

    # By (node opened, node behind the gate), ready for use; shares where several predecessors must agree
    gates: Mapping[tuple[int, int], Gate] = field(default_factory=lambda: _NO_GATES)
    # That a node was visited, to show to another robot; by node
    proofs: Mapping[int, bytes] = field(default_factory=lambda: _NO_PROOFS)
    tried: frozenset[bytes] = frozenset()  # digests of (gate, observation) that failed since the last node was opened

    def add(self, opened: Opened, gate: bytes | None, header: Header) -> Keyring:
        """The keyring with what a node released; without the node's own gate, the gates behind it stay closed."""
        gates = {
            (opened.node, way.target): replace(
                way.gate, share=onward(gate, way.gate.share, header, opened.node, way.target)
            )
            for way in opened.ways
            if way.gate is not None and gate is not None
        }
        return replace(
            self,
            gates=MappingProxyType({**self.gates, **gates}),
            proofs=MappingProxyType({**self.proofs, opened.node: opened.proof}),
        )

    def remember(self, failed: set[bytes], limit: int) -> Keyring:
        """The keyring that knows of tries which failed; of more than `limit` the older ones are forgotten."""
        if not failed:
            return self
        tried = self.tried | failed
        return replace(self, tried=tried if len(tried) <= limit else frozenset(failed))

    def __repr__(self) -> str:
        return "<Keyring>"
