"""How long a mission may take: as long as its ways are."""

from __future__ import annotations

import math

from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission

from .feasible import SPEED_MPS

# A robot goes around what stands there, turns, and waits for people. It may take each way of the shortest net of ways
# there and back, that many times as long as it need be, and so long at each node. Three times was too short: whole
# missions took up to 0.98 of that, and one in a school with dust on its floor was not whole by then.
SLACK, NODE_S, LEAST_S = 4.0, 6.0, 120.0
# A sealed robot tries a dozen things in a step, and only what comes after its last node: it passes by, comes to the end
# of its patience, and back.
SEALED = 1.5
UNPLACED_M = 5.0


def time_for_s(mission: Mission, profile: Profile = Profile.PAPER) -> float:
    """So long may it take to drive to all places of a mission, by the length of the shortest net of its ways."""
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
