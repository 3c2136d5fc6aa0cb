"""Route planning on the encoded graph: lengths of ways are learnt on the way, blocked ways are left out.

Planning needs no secret: it uses only the adjacency of nodes, which is public.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Mapping

from phalanx.mission.file.records import FINAL, JOIN, EncodedMission

UNKNOWN_M = 10.0  # length of a way while no length is known


class Map:
    """The public graph of a mission: successors and predecessors of nodes, join nodes and final nodes."""

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
        """Return False if a node is a join that still waits for a predecessor to be decoded."""
        return node not in self.joins or node in opened or all(other in opened for other in self.before[node])

    def distances(
        self,
        start: int,
        opened: Collection[int],
        lengths_m: Mapping[tuple[int, int], float],
        blocked: Collection[tuple[int, int]],
        wanted: Collection[int] = (),
    ) -> tuple[dict[int, float], dict[int, int]]:
        """Return (metres, previous node) for every reachable node, by Dijkstra's algorithm.

        A way of unknown length counts as the mean of the known ones.

        Args:
            wanted: stop at the nearest of these nodes.
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
        """Return the neighbour to go to next, or None if no way is left.

        With final nodes, head for the nearest, or for the predecessors that a join on the way still needs. Without,
        explore: head for the nearest node that is not decoded and was not reported by another robot.
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
