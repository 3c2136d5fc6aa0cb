"""Planning on the encoded graph: hops are known, lengths are learnt on the way, blocked ways are left out.

Who plans needs no secret: adjacency is public, and nothing else is looked at.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Mapping

from phalanx.mission.file.records import FINAL, JOIN, EncodedMission

UNKNOWN_M = 10.0  # a hop, before any length is known


class Map:
    """The public graph of a mission: successors, predecessors, goals."""

    def __init__(self, mission: EncodedMission) -> None:
        self.after = tuple(tuple(way.target for way in node.ways) for node in mission.nodes)
        before: list[list[int]] = [[] for _ in mission.nodes]
        for node, targets in enumerate(self.after):
            for target in targets:
                before[target].append(node)
        self.before = tuple(map(tuple, before))
        self.joins = frozenset(i for i, node in enumerate(mission.nodes) if node.flags & JOIN)
        self.finals = frozenset(i for i, node in enumerate(mission.nodes) if node.flags & FINAL)

    def may_enter(self, node: int, opened: Collection[int]) -> bool:
        """Return whether all that must come before a node has been decoded."""
        return node not in self.joins or node in opened or all(other in opened for other in self.before[node])

    def distances(
        self,
        start: int,
        opened: Collection[int],
        lengths_m: Mapping[tuple[int, int], float],
        blocked: Collection[tuple[int, int]],
        wanted: Collection[int] = (),
    ) -> tuple[dict[int, float], dict[int, int]]:
        """(metres, node before) for every node that can be reached; a way of unknown length counts as the mean.

        Args:
            wanted: what is farther than the nearest of these is left out.
        """
        typical = sum(lengths_m.values()) / len(lengths_m) if lengths_m else UNKNOWN_M
        done: dict[int, float] = {}
        via: dict[int, int] = {}
        waiting, reach_m = [(0.0, start, start)], math.inf
        while waiting:
            so_far, node, source = heapq.heappop(waiting)
            if so_far > reach_m:
                break
            if node in done:
                continue
            done[node] = so_far
            if node in wanted and node != start:
                reach_m = so_far
            via[node] = source
            for target in self.after[node]:
                if target not in done and (node, target) not in blocked and self.may_enter(target, opened):
                    heapq.heappush(waiting, (so_far + lengths_m.get((node, target), typical), target, node))
        return done, via

    def next_target(
        self,
        at: int,
        opened: Collection[int],
        others: Collection[int],
        lengths_m: Mapping[tuple[int, int], float],
        blocked: Collection[tuple[int, int]],
    ) -> int | None:
        """The neighbour to go to, or None if no way is left.

        A mission with final nodes makes for the nearest; if a join stands before it, for what the join waits for. One
        without explores: the nearest node that is still encoded, and was not reported by another robot.
        """
        dark = {node for node in range(len(self.after)) if node not in opened}
        wanted = self.finals or dark.difference(others)
        metres, via = self.distances(at, opened, lengths_m, blocked, wanted)

        def reachable(wanted: Collection[int]) -> list[int]:
            return [node for node in wanted if node in metres and node != at]

        goals = reachable(wanted)
        if not goals:
            missing = {other for join in self.joins for other in self.before[join] if other not in opened}
            goals = reachable(missing if self.finals else dark)
        if not goals:
            return None
        node = min(goals, key=lambda goal: (metres[goal], goal))
        while via[node] != at:
            node = via[node]
        return node
