"""Predict a mission before it runs: which nodes robots decode, and how long it may take."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission

SPEED_MPS = 0.6  # the pilot's, at most
# A robot goes around what stands there, turns, and waits for people. It may take each way of the shortest net of ways
# there and back, that many times as long as it need be, and so long at each node. Three times was too short: whole
# missions took up to 0.98 of that, and one in a school with dust on its floor was not whole by then.
SLACK, NODE_S, LEAST_S = 4.0, 6.0, 120.0
# A sealed robot tries a dozen things in a step, and only what comes after its last node: it passes by, comes to the end
# of its patience, and back.
SEALED = 1.5
UNPLACED_M = 5.0


@dataclass(frozen=True, slots=True)
class Outlook:
    """Prediction of a mission; nodes by name, each with the reasons."""

    infeasible: dict[str, tuple[str, ...]]  # cannot be decoded: one reason for each way there
    doubtful: dict[str, str]  # may be looked for in the wrong place
    # The others, as a robot finds them: first what needs no other to be known, the nearest first
    order: tuple[str, ...] = ()

    def completes(self, mission: Mission) -> bool:
        """Return whether each part can be lived to its end: to a final node, or to all of them."""
        for part in mission.parts:
            names = {node.name for node in mission.nodes if node.part == part}
            finals = {node.name for node in mission.nodes if node.part == part and node.final}
            if finals <= self.infeasible.keys() if finals else names & self.infeasible.keys():
                return False
        return True


def time_for_s(mission: Mission, profile: Profile = Profile.PAPER) -> float:
    """Return how long driving to all places of a mission may take, by the length of the shortest net of its ways."""
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
