"""Predict which nodes no robot can be expected to decode, by simulating its belief along the ways.

Each way is driven straight, with the odometry errors of `MissionConfig`, past the landmarks known by then. All else is
optimistic: robots drive around obstacles at no cost, and see each landmark in sight that scans show from some floor
around it. So an infeasible node can be decoded only by luck, while a feasible one may still fail.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from phalanx.config.lidar import LidarConfig
from phalanx.config.mission import MissionConfig
from phalanx.mission.angles import wrap_rad
from phalanx.mission.authoring.compiling import direction_of
from phalanx.mission.authoring.findable import SimulatedScans, is_duplicate
from phalanx.mission.authoring.free import GRID_M, Free
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.observable import Experience, Landmark, Position
from phalanx.mission.pose.belief import Belief
from phalanx.mission.walk.fix import (
    AGAIN_MOST,
    ALONE_SIGMAS,
    Match,
    distance_m,
    doubt_m,
    fix_from,
    fixed,
    initial_belief,
    is_sure,
    is_there,
    odometry_errors_of,
    pose_doubt_m,
    unambiguous,
)

from .outlook import SPEED_MPS, Outlook

LINE = 0.75  # share of the time-out for which the pilot follows one direction
NORTH_RAD = math.pi / 2  # start heading for a building without one
STEP_M = 0.25
# Landmarks lie in walls: lines of sight end this far in front of them.
BEFORE_M = 0.1
# A robot may see the end of a wall from slightly behind the wall's line.
FACES, BEHIND_M = ("concave_left", "concave_right"), -0.05
ROOM_M = 0.5  # a room is recognised by its corners, so also from a robot within this distance of its middle
# Scans must show a landmark from this much floor, or robots drive past it.
SHOWN_M2, SHOWN_STEPS = 0.25, 2  # or in this number of steps on a straight way
BEYOND_M = 3.0  # a robot looks for a landmark until this far past it; if a wall stops it, it turns around
TURNED_RAD, TURNS = math.radians(20), range(-8, 10)
EVERY = 29  # places around a landmark are scanned in strides of this, as the first may all be in one corner
Way = tuple[str, str]


@dataclass(frozen=True, slots=True)
class _Reached:
    """A robot at a decoded node, with its belief, or None if the node has no place."""

    belief: Belief | None
    length_m: float = 0.0  # length of the path so far
    by: Way | None = None  # the last way


def look_ahead(
    mission: Mission,
    config: MissionConfig | None = None,
    plan: FloorPlan | None = None,
    lidar: LidarConfig | None = None,
) -> Outlook:
    """Return the prediction for all nodes that ways lead to.

    Args:
        plan: the building; without one all landmarks within range are in sight.
    Source: Encoded graphs §VI-B, §VI-F; docs/adr/0025-a-pose-that-knows-its-doubt.md.
    """
    return _Predictor(mission, config or MissionConfig(), plan, lidar or LidarConfig()).run()


def failing_ways(
    mission: Mission, plan: FloorPlan, lidar: LidarConfig | None = None
) -> tuple[Outlook, set[Way], set[Way]]:
    """Return the prediction; ways that work only once more landmarks are known; and ways that never work.

    A robot has no map, so it tries any way, and may get lost on one that fails.
    """
    scout = _Predictor(mission, MissionConfig(), plan, lidar or LidarConfig())
    outlook, vain = scout.run(), scout.always_failing() | scout.vain
    late = vain & {stand.by for stand in scout.at.values() if stand.by is not None}
    return outlook, late, vain - late


class _Predictor:
    """Simulates a robot from node to node, nearest first."""

    def __init__(self, mission: Mission, config: MissionConfig, plan: FloorPlan | None, lidar: LidarConfig) -> None:
        self.config = replace(config.seen_by(lidar), decode_m=min(config.decode_m, lidar.range_max_m))
        self.mission, self.plan, self.fov_rad = mission, plan, lidar.fov_rad
        self.nodes = {node.name: node for node in mission.nodes}
        self.before: dict[str, set[str]] = {}
        self.after: dict[str, list[PlainWay]] = {}
        for way in mission.ways:
            self.before.setdefault(way.target, set()).add(way.source)
            self.after.setdefault(way.source, []).append(way)
        self.at: dict[str, _Reached] = {}  # decoded nodes
        self.known: list[Landmark] = []
        self.doubtful: dict[str, str] = {}
        self.vain: set[Way] = set()  # ways that failed at the first try
        starts = [node.place for node in mission.nodes if node.start and node.place is not None]
        self.free = None if plan is None else Free(plan, starts)
        self.looks = None if plan is None else SimulatedScans(plan, lidar, as_drawn=True)
        self.shown_m2: dict[str, float] = {}

    def run(self) -> Outlook:
        """Return the prediction, see `look_ahead`."""
        waiting = [(0.0, node.name, self._begun(node)) for node in self.mission.nodes if node.start]
        while True:
            self._decode(waiting)
            # A way that failed may work now that more landmarks are known.
            tried = [(way, self._along(way, self.at[way.source])) for way in self._left()]
            waiting = [(end.length_m, way.target, end) for way, end in tried if isinstance(end, _Reached)]
            if not waiting:
                break
        why: dict[str, list[str]] = {}
        for way, end in tried:
            if isinstance(end, str):
                why.setdefault(way.target, []).append(f"from {way.source}: {end}")
        led_to, fresh = set(self.at), list(self.at)
        while fresh:
            fresh = [way.target for way in self.after.get(fresh.pop(), ()) if way.target not in led_to] + fresh
            led_to.update(fresh)
        behind = ("only reachable through nodes that cannot be decoded",)
        dark = {name: tuple(why.get(name, behind)) for name in self.nodes if name in led_to - self.at.keys()}
        doubtful = {name: why for name, why in self.doubtful.items() if name not in dark}
        return Outlook(dark, doubtful, tuple(self.at))

    def always_failing(self) -> set[Way]:
        """Return the ways that fail even with all landmarks known; call it after `run`."""
        known, vain = self.known, set[Way]()
        for way in self.mission.ways:
            if way.source in self.at and way.target in self.at:
                own = _things(self.nodes[way.target])
                self.known = [thing for thing in known if thing not in own]
                if isinstance(self._along(way, self.at[way.source]), str):
                    vain.add((way.source, way.target))
        self.known = known
        return vain

    def _decode(self, waiting: list[tuple[float, str, _Reached]]) -> None:
        """Decode all nodes that can be reached from `waiting`, nearest first."""
        heap = [(length_m, i, name, stand) for i, (length_m, name, stand) in enumerate(waiting)]
        heapq.heapify(heap)
        count = len(heap)
        while heap:
            _, _, name, stand = heapq.heappop(heap)
            if name in self.at:
                continue
            self.at[name] = stand
            self.known += [thing for thing in _things(self.nodes[name]) if isinstance(thing, Landmark)]
            for way in self._left(name):
                end = self._along(way, self.at[way.source])
                if isinstance(end, _Reached):
                    heapq.heappush(heap, (end.length_m, count := count + 1, way.target, end))
                else:
                    self.vain.add((way.source, way.target))

    def _left(self, name: str | None = None) -> Iterator[PlainWay]:
        """Yield ways to nodes that are not decoded and may be entered: from all decoded nodes, or from one."""
        for source in self.at if name is None else (name,):
            for way in self.after.get(source, ()):
                is_open = not self.nodes[way.target].join or self.before[way.target] <= self.at.keys()
                if way.target not in self.at and is_open:
                    yield way

    def _begun(self, node: Node) -> _Reached:
        heading = 0.0 if self.plan is None else self.plan.start[2] if self.plan.start else NORTH_RAD
        return _Reached(None if node.place is None else initial_belief(self.config, (*node.place, heading)))

    def _along(self, way: PlainWay, stand: _Reached) -> _Reached | str:
        """Return the robot at the end of a way, or the reason why it does not get there."""
        source, target = self.nodes[way.source], self.nodes[way.target]
        there, belief = target.place, stand.belief
        if way.do is not None or there is None or belief is None:
            # The path is unknown: assume that the robot arrives with a known pose.
            return replace(self._begun(target), length_m=stand.length_m, by=(way.source, way.target))
        x, y, heading = belief.pose
        length_m = math.dist((x, y), there)
        near_m = self._near_m(target)
        limit_m = LINE * SPEED_MPS * (source.timeout_s or self.config.timeout_s)
        if length_m - near_m > limit_m:
            return f"{length_m:.1f} m away, but a robot follows a direction for at most {limit_m:.1f} m"
        direction = direction_of(way, (x, y), there)
        if way.direction_rad is not None or direction is None:
            direction = direction_of(PlainWay(source=way.source, target=way.target), (x, y), there) or heading
        belief = belief.moved(0.0, wrap_rad(direction - heading), odometry_errors_of(self.config))
        end = self._driven(source, target, belief, length_m)
        return end if isinstance(end, str) else _Reached(end, stand.length_m + length_m, (way.source, way.target))

    def _driven(self, source: Node, target: Node, belief: Belief, length_m: float) -> Belief | str:
        """Return the belief of a robot that has driven to the target, or the reason why it does not decode it."""
        passed, side = list[Experience](), self._side(source, target)
        whys = [
            "not in sight from any place where a robot fits" if side is None else "not in sight on the straight way"
        ]
        is_decoded, there, shown, found = False, belief, side is not None, 0
        steps = max(1, math.ceil(length_m / STEP_M))
        for i in range(steps + (round(BEYOND_M / STEP_M) if shown else 0) + 1):
            seen = Experience(0.0, *belief.pose, spread=belief.pose_covariance)
            eyes = [seen] if side is None else self._eyes(seen, side, target)
            if i > steps and not (is_decoded or eyes) and passed:
                # A wall stops the robot, and it turns around.
                turned = (replace(passed[-1], heading_rad=seen.heading_rad + k * TURNED_RAD) for k in TURNS)
                is_decoded = any(self._decodes(target, each, self._again(each), whys, shown=True) for each in turned)
            if i > steps and (is_decoded or not eyes):
                break
            if eyes:
                passed.append(eyes[0])
                again = self._again(eyes[0])
                if not is_decoded and any(self._decodes(target, eye, again, whys, shown=shown) for eye in eyes):
                    found += 1
                    is_decoded = found >= (SHOWN_STEPS if shown else 1)
                if is_decoded:
                    again = [*again, *((thing, thing) for thing in self._in_sight(eyes[0], target))]
                certain = [] if is_sure(self.config, eyes[0]) else self._certain(eyes[0], again)
                if certain:
                    belief = fixed(self.config, belief, fix_from(self.config, eyes[0], certain))
            there = belief if i <= steps or is_decoded else there
            belief = belief.moved(length_m / steps, 0.0, odometry_errors_of(self.config))
        if found and not is_decoded:
            whys.append(f"scans show it from one place on the straight way, robots need {SHOWN_STEPS}")
        if not is_decoded and (shown or not (len(whys) == 1 and self._is_seen_beside(target))):
            return whys[-1]
        return there if shown else self._why_not_shown(target, passed) or there

    def _side(self, source: Node, target: Node) -> int | None:
        """Return `Free.side_of` for a way to a target that a lidar shows, else None."""
        are_shown = all(isinstance(each, Landmark) and each.text is None for each in _things(target))
        if self.free is None or not are_shown or source.place is None or target.place is None:
            return None
        return self.free.side_of(source.place, target.place)

    def _eyes(self, seen: Experience, side: int, target: Node) -> list[Experience]:
        """Return poses on a way: on its line or this side of it; if the target is no doorway, more beside it."""
        assert self.free is not None, "only a way in a floor plan has a side"
        places = list(self.free.beside_line((seen.x_m, seen.y_m), seen.heading_rad, side))
        if all(isinstance(thing, Landmark) and thing.type == "doorway" for thing in _things(target)):
            places = places[:1]
        elif places:
            places += self.free.again_beside(places[0], seen.heading_rad)
        return [replace(seen, x_m=x, y_m=y) for x, y in places]

    def _near_m(self, target: Node) -> float:
        """Return the largest distance from which a node is decoded."""
        if not any(isinstance(thing, Landmark) for thing in _things(target)):
            return 0.0
        return min(target.within_m or math.inf, self.config.decode_m)

    def _decodes(self, target: Node, seen: Experience, again: list[Match], whys: list[str], *, shown: bool) -> bool:
        """Return True if a node is decoded from a pose; if not, append the reason to `whys`.

        Args:
            shown: a simulated scan from this pose must show the landmark.
        """
        if any(isinstance(thing, Position) for thing in _things(target)):
            doubt, most_m = pose_doubt_m(seen), self.config.place_m / ALONE_SIGMAS
            if doubt > most_m:
                whys.append(f"uncertainty of the position {doubt:.2f} m, more than {most_m:.2f} m")
            return is_there(self.config, seen, *(target.place or (0.0, 0.0)))
        for thing in self._in_sight(seen, target):
            if any(is_duplicate(thing, known) for known in self.known):
                whys.append("mistaken for a known node centimetres away: give both the same place")
                continue
            if shown and not (self.looks and self.looks.shows(_pose(seen), thing)):
                whys[1:] = whys[1:] or ["scans do not show it on the straight way"]
                continue
            doubt = doubt_m(self.config, seen, thing)
            if not any(truth is thing for truth, _ in self._certain(seen, [(thing, thing), *again])):
                whys.append(f"uncertainty {doubt:.2f} m, with a look-alike at {thing.apart_m:.1f} m")
                continue
            if doubt > self.config.tolerance_m:
                unsure = f"uncertainty {doubt:.2f} m, but searched within {self.config.tolerance_m:g} m only"
                self.doubtful[target.name] = unsure
            return True
        return False

    def _certain(self, seen: Experience, matches: Sequence[Match]) -> list[Match]:
        """Return the matches that are unambiguous even if the pose is off by its standard deviation."""
        off = (
            (truth, replace(truth, apart_m=truth.apart_m - doubt_m(self.config, seen, truth))) for truth, _ in matches
        )
        return unambiguous(self.config, seen, list(off))

    def _again(self, seen: Experience) -> list[Match]:
        """Return the known landmarks that the robot sees again."""
        near = ((distance_m(seen, thing), thing) for thing in self.known)
        first = sorted(((away, thing) for away, thing in near if away <= self.config.decode_m), key=lambda row: row[0])
        in_sight = (thing for _, thing in first if self._sees(seen, thing))
        return [(thing, thing) for thing in islice(in_sight, AGAIN_MOST)]

    def _in_sight(self, seen: Experience, target: Node) -> list[Landmark]:
        """Return the node's landmarks that are visible from where a robot can be."""
        if self.free is not None and not self.free.is_near(seen.x_m, seen.y_m):
            return []
        return [
            thing
            for thing in _things(target)
            if isinstance(thing, Landmark)
            and distance_m(seen, thing) <= self._near_m(target)
            and self._sees(seen, thing)
        ]

    def _is_seen_beside(self, target: Node) -> bool:
        """Return True if a node is in sight from any free place near it: robots may leave the straight way."""
        return any(
            self._is_clear(place, thing)
            for thing in _things(target)
            if isinstance(thing, Landmark)
            for place in self._places(thing, self._near_m(target))
        )

    def _why_not_shown(self, target: Node, passed: Sequence[Experience]) -> str:
        """Return why scans do not show a node that is in sight, or "".

        An example is a door with both jambs out of the lidar's range.

        Args:
            passed: poses on the straight way.
        """
        things = [thing for thing in _things(target) if isinstance(thing, Landmark)]
        if self.looks is None or not things:
            return ""
        if target.name not in self.shown_m2:
            self.shown_m2[target.name] = max(self._shown_m2(thing, self._near_m(target)) for thing in things)
        shown_m2, looks = self.shown_m2[target.name], self.looks
        shows = (looks.shows(_pose(seen), thing) for seen in passed for thing in self._in_sight(seen, target))
        if shown_m2 >= SHOWN_M2 or any(shows):
            return ""
        return f"scans show it from {shown_m2:.1f} m2 of floor, robots need {SHOWN_M2:g} m2"

    def _shown_m2(self, thing: Landmark, near_m: float) -> float:
        """Return the area of the floor from which a scan shows a landmark; stop counting at SHOWN_M2."""
        assert self.looks is not None, "only called with a floor plan"
        shown_m2, places = 0.0, list(self._places(thing, near_m))
        for i in range(EVERY):
            for x, y in places[i::EVERY]:
                pose = x, y, math.atan2(thing.y_m - y, thing.x_m - x)
                if self._is_clear((x, y), thing) and self.looks.shows(pose, thing):
                    shown_m2 += GRID_M * GRID_M
                if shown_m2 >= SHOWN_M2:
                    return shown_m2
        return shown_m2

    def _places(self, thing: Landmark, near_m: float) -> Iterator[tuple[float, float]]:
        return self.free.places(thing.x_m, thing.y_m, near_m) if self.free else iter(())

    def _sees(self, seen: Experience, thing: Landmark) -> bool:
        dx, dy = thing.x_m - seen.x_m, thing.y_m - seen.y_m
        away = math.hypot(dx, dy)
        if thing.type == "room" and away <= ROOM_M:
            return True
        if thing.type in FACES and -math.cos(math.atan2(dy, dx) - (thing.orientation_rad or 0.0)) * away < BEHIND_M:
            return False
        is_before = abs(wrap_rad(math.atan2(dy, dx) - seen.heading_rad)) <= self.fov_rad / 2
        return is_before and self._is_clear((seen.x_m, seen.y_m), thing)

    def _is_clear(self, eye: tuple[float, float], thing: Landmark) -> bool:
        """Return True if no wall is between a place and a landmark, except the wall that the landmark is in."""
        away = math.dist(eye, (thing.x_m, thing.y_m))
        share = max(0.0, 1 - BEFORE_M / max(away, BEFORE_M))
        place = eye[0] + share * (thing.x_m - eye[0]), eye[1] + share * (thing.y_m - eye[1])
        return self.plan is None or self.plan.sees(eye, place)


def _pose(seen: Experience) -> tuple[float, float, float]:
    return seen.x_m, seen.y_m, seen.heading_rad


def _things(node: Node) -> list[Landmark | Position]:
    return [thing for alias in node.see for thing in alias if isinstance(thing, Landmark | Position)]
