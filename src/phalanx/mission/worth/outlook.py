"""Prediction of a mission: nodes that robots can decode, and the time needed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission

SPEED_MPS = 0.6  # largest speed of the pilot
# The time limit: each way of the minimum spanning tree there and back, SLACK times as long as at full speed, since a
# robot avoids obstacles, turns and waits for people; plus NODE_S per node. A SLACK of 3 was too short: complete
# missions took up to 0.98 of that limit, and one in a school with specks in its map was not complete by then.
SLACK, NODE_S, LEAST_S = 4.0, 6.0, 120.0
# In the sealed profile a robot tries only a dozen candidates in a step, and only nodes after its last one. So it may
# pass a node, time out and return.
SEALED = 1.5
UNPLACED_M = 5.0  # assumed length of a way without places


@dataclass(frozen=True, slots=True)
class Outlook:
    """Prediction of a mission; nodes by name, with reasons."""

    infeasible: dict[str, tuple[str, ...]]  # nodes that cannot be decoded, with a reason for each way there
    doubtful: dict[str, str]  # nodes that may lie outside the region that a robot searches, with the reason
    # The decoded nodes in the order of the prediction, nearest first
    order: tuple[str, ...] = ()

    def completes(self, mission: Mission) -> bool:
        """Return True if each part can be completed: a final node, or without one all nodes, can be decoded."""
        for part in mission.parts:
            names = {node.name for node in mission.nodes if node.part == part}
            finals = {node.name for node in mission.nodes if node.part == part and node.final}
            if finals <= self.infeasible.keys() if finals else names & self.infeasible.keys():
                return False
        return True


def time_limit_s(mission: Mission, profile: Profile = Profile.PAPER) -> float:
    """Return a time limit for a mission, from the length of the minimum spanning tree of its ways."""
    places = {node.name: node.place for node in mission.nodes}
    net = {name: name for name in places}

    def root(name: str) -> str:
        while net[name] != name:
            name = net[name]
        return name

    def length_m(source: str, target: str) -> float:
        a, b = places[source], places[target]
        return UNPLACED_M if a is None or b is None else math.dist(a, b)

    whole_m = 0.0
    lengths = ((length_m(way.source, way.target), way.source, way.target) for way in mission.ways)
    for way_m, source, target in sorted(lengths):
        if root(source) != root(target):
            net[root(source)] = root(target)
            whole_m += way_m
    often = SEALED if profile is Profile.SEALED else 1.0
    return round(often * (LEAST_S + NODE_S * len(places) + SLACK * 2 * whole_m / SPEED_MPS))
