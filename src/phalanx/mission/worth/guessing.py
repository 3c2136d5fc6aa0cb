"""Count an attacker's candidates for each node of a mission, with a floor plan, or with only the size of the map."""

from __future__ import annotations

import math
from collections.abc import Sequence

from phalanx.config.mission import CodingConfig
from phalanx.mission.angles import TWO_PI
from phalanx.mission.authoring.compiling import alias_offset, direction_of, place_of
from phalanx.mission.authoring.document import TOKEN
from phalanx.mission.file.canonical import shape_of
from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.observable import MM_PER_M, Landmark, Observable, Sensor, bins_of, sector_of
from phalanx.mission.walk.search import WINDOWS

from .shown import Before, PlanCandidates, cell_in

OUT_OF_REACH = float(1 << 128)  # a number of candidates that no attacker can try
Alias = tuple[Observable, ...]


class Guess:
    """Upper bounds of the candidates of an attacker who tries one node after the other; cheaper orders are known."""

    def __init__(
        self, mission: Mission, coding: CodingConfig, profile: Profile, open_start: bool, plan: PlanCandidates | None
    ) -> None:
        self.coding, self.profile, self.open_start = coding, profile, open_start
        self.plan = plan
        self.box = mission.box_m
        self.nodes = {node.name: node for node in mission.nodes}
        self.before: dict[str, list[PlainWay]] = {}
        for way in mission.ways:
            self.before.setdefault(way.target, []).append(way)
        done = [node.do for node in mission.nodes if node.do] + [way.do for way in mission.ways if way.do]
        self.actions = set(done)
        self.shapes = {shape_of(alias) for node in mission.nodes for alias in node.see}

    def candidates(self, node: Node, *, nearest: bool = False) -> float:
        """Return the number of candidates with only the map's size, for the weakest alias and the best predecessor.

        Args:
            nearest: count candidates in order of distance from the previous node, up to the true place.
        """
        counts = [
            self._places(alias, node, way, nearest=nearest) * self._rest(alias, node)
            for alias in node.see
            for way in self._ways(node)
        ]
        return min([OUT_OF_REACH, *counts])

    def by_plan(self, node: Node) -> float | None:
        """Return the number of tries with the floor plan, in the order of `crack_sealed`; None without a plan.

        That is alias by alias, best candidates first, and places that the plan does not show last.
        """
        if self.plan is None:
            return None
        return min([OUT_OF_REACH] + [self._by_plan(self.plan, node, way) for way in self._ways(node)])

    def _ways(self, node: Node) -> Sequence[PlainWay | None]:
        """Return the ways from which a node can be tried; None stands for no previous node, () for no start key."""
        if self.profile is Profile.SEALED and node.start and not self.open_start:
            return ()
        return [None] if node.start else self.before.get(node.name, [None])

    def _by_plan(self, plan: PlanCandidates, node: Node, way: PlainWay | None) -> float:
        before, tried = self._before(node, way), 0.0
        # The attacker starts with the alias that costs least, and stops at one that is out of reach.
        for alias in sorted(node.see, key=lambda each: self._rest(each, node)):
            place, shape, rest = place_of(alias), shape_of(alias), self._rest(alias, node)
            if place is None or rest >= OUT_OF_REACH:
                return tried + rest
            offset = alias_offset(self.coding, alias, plan.rounded_mm)
            wanted = cell_in(self.coding, shape, offset, place)
            for cell in plan.cells(self.coding, before, shape, offset):
                tried += rest
                if cell == wanted:
                    return tried
        return tried + min(self._places(alias, node, way) * self._rest(alias, node) for alias in node.see)

    def _rest(self, alias: Alias, node: Node) -> float:
        """Return the number of tries for each place, due to the other observables in the hash."""
        shape = shape_of(alias)
        count = float(16 ** min(32, sum(map(len, _tokens(alias)))))
        if self.profile is Profile.PAPER:
            count *= len(self.shapes)  # the file lists the shapes that occur, not their nodes
            count *= max(1, len(self.actions)) if node.do else 1
        count *= len(WINDOWS) if shape.time else 1
        # A message is 32 random bytes from a controller, or from a robot whose part was not captured.
        return count * (OUT_OF_REACH if node.wait else 1)

    def _places(self, alias: Alias, node: Node, way: PlainWay | None, *, nearest: bool = False) -> float:
        """Return the number of cells and bins of an alias, given the direction that the previous node reveals."""
        shape = shape_of(alias)
        if not shape.place:
            return 1.0
        x0, y0, x1, y1 = self.box
        delta_m = self.coding.delta_mm / MM_PER_M
        bins = bins_of(self.coding, thing.type) if shape.oriented and (thing := landmark_of(alias)) else 1
        areas = max(1.0, (x1 - x0) * (y1 - y0) / 2 / self.coding.area_m2) if shape.area else 1
        everywhere = max(1.0, (x1 - x0) * (y1 - y0) / delta_m**2)
        before = self._before(node, way)
        if before is None:
            return everywhere * bins * areas
        # The wedge of one sector up to the edge of the map, at least one cell wide.
        half = math.pi / before.sectors
        reaches = [_to_edge(self.box, before[:2], before.direction_rad + k * half) for k in (-1.0, 0.0, 1.0)]
        if nearest and (place := place_of(alias)):
            far_m = math.dist(before[:2], (place.x_m, place.y_m)) + delta_m
            reaches = [min(reach, far_m) for reach in reaches]
        wedge = (reaches[0] ** 2 + 4 * reaches[1] ** 2 + reaches[2] ** 2) / 6 * half
        return min(everywhere, max(1.0, wedge / delta_m**2 + reaches[1] / delta_m)) * bins * areas

    def _before(self, node: Node, way: PlainWay | None) -> Before | None:
        """Return what the previous node reveals."""
        if way is None or way.do is not None:
            return None
        source, sectors = self.nodes[way.source].place, self.coding.sectors
        direction = direction_of(way, source, node.place)
        if direction is None or source is None:
            return None
        return Before(*source, sector_of(direction, sectors) * TWO_PI / sectors, sectors)


def _tokens(alias: Alias) -> list[str]:
    """Return the random tokens among texts and readings; other texts and readings count as public."""
    landmark = landmark_of(alias)
    texts = [landmark.text] if landmark and landmark.text else []
    texts += [thing.value.decode(errors="replace").lower() for thing in alias if isinstance(thing, Sensor)]
    return [text for text in texts if TOKEN.fullmatch(text)]


def landmark_of(alias: Alias) -> Landmark | None:
    """Return the landmark in a conjunction, or None."""
    place = place_of(alias)
    return place if isinstance(place, Landmark) else None


def _to_edge(box: tuple[float, float, float, float], at: tuple[float, float], direction_rad: float) -> float:
    """Return the distance in metres from a place to the edge of the map."""
    x0, y0, x1, y1 = box
    dx, dy = math.cos(direction_rad), math.sin(direction_rad)
    out = math.hypot(x1 - x0, y1 - y0)
    for position, low, high, step in ((at[0], x0, x1, dx), (at[1], y0, y1, dy)):
        if abs(step) > 1e-9:
            out = min(out, max(0.0, ((high if step > 0 else low) - position) / step))
    return out
