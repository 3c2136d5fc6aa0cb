"""Which nodes no robot can be expected to decode, told before anybody drives: a robot's belief, run ahead of it.

Each way is driven in thought, straight, by odometry that may err as `MissionConfig` says, past what is known by then.
All else is as good as can be: what stands in the way is gone around at no cost, and each landmark in sight is seen, if
scans show it from some floor around. So what is called infeasible is but for luck; what is not may still fail by
chance.
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
from phalanx.mission.authoring.findable import Looks, is_written_twice
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
    pose_doubt_m,
    unambiguous,
    wheels_of,
)

from .outlook import SPEED_MPS, Outlook

LINE = 0.75  # as the pilot drives along one direction: for so much of its time-out
NORTH_RAD = math.pi / 2  # robots look there in a building that does not say
STEP_M = 0.25
# Landmarks lie in walls: a place so much before one is looked at.
BEFORE_M = 0.1
# Who is no farther behind the line of a face may see the end of it.
FACES, BEHIND_M = ("concave_left", "concave_right"), -0.05
ROOM_M = 0.5  # a room's middle is told by its corners: it is seen from its midst too
# Scans are to show a landmark from so much floor, or robots drive past it.
SHOWN_M2, SHOWN_STEPS = 0.25, 2  # or, on a straight way, after so many steps
BEYOND_M = 3.0  # who has driven past a thing looks back for so long, and where a wall stops it to all sides
TURNED_RAD, TURNS = math.radians(20), range(-8, 10)
EVERY = 29  # places around it are looked from in this order: one, and so many further on the next
Way = tuple[str, str]


@dataclass(frozen=True, slots=True)
class _Reached:
    """A robot at a node: what it believes, if the node has a place."""

    belief: Belief | None
    length_m: float = 0.0  # of the way so far
    by: Way | None = None  # the last of it, from and to


def look_ahead(
    mission: Mission,
    config: MissionConfig | None = None,
    plan: FloorPlan | None = None,
    lidar: LidarConfig | None = None,
) -> Outlook:
    """Which nodes robots cannot be expected to decode, of those that ways lead to.

    Args:
        plan: the building; without one everything is in sight that is near enough.
    Source: Encoded graphs §VI-B, §VI-F; docs/adr/0025-a-pose-that-knows-its-doubt.md.
    """
    return _Predictor(mission, config or MissionConfig(), plan, lidar or LidarConfig()).run()


def ways_in_vain(
    mission: Mission, plan: FloorPlan, lidar: LidarConfig | None = None
) -> tuple[Outlook, set[Way], set[Way]]:
    """Return the outlook; ways that failed until the robot knew more; and ways it could skip.

    A robot holds no map, tries any way, and may be lost on one that fails.
    """
    scout = _Predictor(mission, MissionConfig(), plan, lidar or LidarConfig())
    outlook, vain = scout.run(), scout.in_vain() | scout.vain
    late = vain & {stand.by for stand in scout.at.values() if stand.by is not None}
    return outlook, late, vain - late


class _Predictor:
    """Goes ahead from node to node, the nearest first."""

    def __init__(self, mission: Mission, config: MissionConfig, plan: FloorPlan | None, lidar: LidarConfig) -> None:
        self.config = replace(config.seen_by(lidar), decode_m=min(config.decode_m, lidar.range_max_m))
        self.mission, self.plan, self.fov_rad = mission, plan, lidar.fov_rad
        self.nodes = {node.name: node for node in mission.nodes}
        self.before: dict[str, set[str]] = {}
        self.after: dict[str, list[PlainWay]] = {}
        for way in mission.ways:
            self.before.setdefault(way.target, set()).add(way.source)
            self.after.setdefault(way.source, []).append(way)
        self.at: dict[str, _Reached] = {}  # what was decoded
        self.known: list[Landmark] = []
        self.doubtful: dict[str, str] = {}
        self.vain: set[Way] = set()  # at first
        starts = [node.place for node in mission.nodes if node.start and node.place is not None]
        self.free = None if plan is None else Free(plan, starts)
        self.looks = None if plan is None else Looks(plan, lidar, as_drawn=True)
        self.shown_m2: dict[str, float] = {}

    def run(self) -> Outlook:
        """Return the outlook, see `look_ahead`."""
        waiting = [(0.0, node.name, self._begun(node)) for node in self.mission.nodes if node.start]
        while True:
            self._decode(waiting)
            # Where more is known, a way that failed may be found.
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
        behind = ("only by way of what cannot be decoded",)
        dark = {name: tuple(why.get(name, behind)) for name in self.nodes if name in led_to - self.at.keys()}
        doubtful = {name: why for name, why in self.doubtful.items() if name not in dark}
        return Outlook(dark, doubtful, tuple(self.at))

    def in_vain(self) -> set[Way]:
        """The ways that are in vain whatever is known, after `run`."""
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
        """All that can be from here."""
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
        """Ways to what is still dark and may be entered: all, or out of one node (into a join from any)."""
        for source in self.at if name is None else (name,):
            for way in self.after.get(source, ()):
                is_open = not self.nodes[way.target].join or self.before[way.target] <= self.at.keys()
                if way.target not in self.at and is_open:
                    yield way

    def _begun(self, node: Node) -> _Reached:
        heading = 0.0 if self.plan is None else self.plan.start[2] if self.plan.start else NORTH_RAD
        return _Reached(None if node.place is None else initial_belief(self.config, (*node.place, heading)))

    def _along(self, way: PlainWay, stand: _Reached) -> _Reached | str:
        """The robot at the end of a way, or why it does not get there."""
        source, target = self.nodes[way.source], self.nodes[way.target]
        there, belief = target.place, stand.belief
        if way.do is not None or there is None or belief is None:
            # Nobody here knows how it gets there.
            return replace(self._begun(target), length_m=stand.length_m, by=(way.source, way.target))
        x, y, heading = belief.pose
        length_m = math.dist((x, y), there)
        near_m = self._near_m(target)
        limit_m = LINE * SPEED_MPS * (source.timeout_s or self.config.timeout_s)
        if length_m - near_m > limit_m:
            return f"{length_m:.1f} m, and before its time-out a robot follows a direction for {limit_m:.1f} m"
        direction = direction_of(way, (x, y), there)
        if way.direction_rad is not None or direction is None:
            direction = direction_of(PlainWay(source=way.source, target=way.target), (x, y), there) or heading
        belief = belief.moved(0.0, wrap_rad(direction - heading), wheels_of(self.config))
        end = self._driven(source, target, belief, length_m)
        return end if isinstance(end, str) else _Reached(end, stand.length_m + length_m, (way.source, way.target))

    def _driven(self, source: Node, target: Node, belief: Belief, length_m: float) -> Belief | str:
        """The belief of a robot that has driven from one node to the next, or why it has not seen that."""
        passed, side = list[Experience](), self._side(source, target)
        whys = [
            "in sight from nowhere that a robot can be" if side is None else "not in sight on the straight way there"
        ]
        is_decoded, there, shown, found = False, belief, side is not None, 0
        steps = max(1, math.ceil(length_m / STEP_M))
        for i in range(steps + (round(BEYOND_M / STEP_M) if shown else 0) + 1):
            seen = Experience(0.0, *belief.pose, spread=belief.doubt)
            eyes = [seen] if side is None else self._eyes(seen, side, target)
            if i > steps and not (is_decoded or eyes) and passed:
                # A wall stops it, and it turns.
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
                certain = [] if is_sure(self.config, eyes[0]) else self._told(eyes[0], again)
                if certain:
                    belief = fixed(self.config, belief, fix_from(self.config, eyes[0], certain))
            there = belief if i <= steps or is_decoded else there
            belief = belief.moved(length_m / steps, 0.0, wheels_of(self.config))
        if found and not is_decoded:
            whys.append(f"scans show it from one place on the straight way there, and robots come by {SHOWN_STEPS}")
        if not is_decoded and (shown or not (len(whys) == 1 and self._is_seen_beside(target))):
            return whys[-1]
        return there if shown else self._why_not_shown(target, passed) or there

    def _side(self, source: Node, target: Node) -> int | None:
        """On which side of its line a way to what scans show is straight, as `Free.side_of` has it."""
        are_shown = all(isinstance(each, Landmark) and each.text is None for each in _things(target))
        if self.free is None or not are_shown or source.place is None or target.place is None:
            return None
        return self.free.side_of(source.place, target.place)

    def _eyes(self, seen: Experience, side: int, target: Node) -> list[Experience]:
        """Return the poses of robots that go there: on the line or on this side; to a non-door also beside it."""
        assert self.free is not None, "a way has a side where there is a plan"
        places = list(self.free.beside_line((seen.x_m, seen.y_m), seen.heading_rad, side))
        if all(isinstance(thing, Landmark) and thing.type == "doorway" for thing in _things(target)):
            places = places[:1]
        elif places:
            places += self.free.again_beside(places[0], seen.heading_rad)
        return [replace(seen, x_m=x, y_m=y) for x, y in places]

    def _near_m(self, target: Node) -> float:
        """From where a node counts."""
        if not any(isinstance(thing, Landmark) for thing in _things(target)):
            return 0.0
        return min(target.within_m or math.inf, self.config.decode_m)

    def _decodes(self, target: Node, seen: Experience, again: list[Match], whys: list[str], *, shown: bool) -> bool:
        """Return whether a node is believed from here; if not, and it might have been, says why.

        Args:
            shown: a scan has to show it, from just here.
        """
        if any(isinstance(thing, Position) for thing in _things(target)):
            doubt, most_m = pose_doubt_m(seen), self.config.place_m / ALONE_SIGMAS
            if doubt > most_m:
                whys.append(f"unsure of its own place by {doubt:.2f} m, more than {most_m:.2f} m")
            return is_there(self.config, seen, *(target.place or (0.0, 0.0)))
        for thing in self._in_sight(seen, target):
            if any(is_written_twice(thing, known) for known in self.known):
                whys.append(
                    "it is taken for a node that is known by then, centimetres from it: write one place for both"
                )
                continue
            if shown and not (self.looks and self.looks.shows(_pose(seen), thing)):
                whys[1:] = whys[1:] or ["scans do not show it on the straight way there"]
                continue
            doubt = doubt_m(self.config, seen, thing)
            if not any(truth is thing for truth, _ in self._told(seen, [(thing, thing), *again])):
                whys.append(f"unsure by {doubt:.2f} m, and {thing.apart_m:.1f} m from it something looks the same")
                continue
            if doubt > self.config.tolerance_m:
                unsure = f"unsure by {doubt:.2f} m there, and looked for within {self.config.tolerance_m:g} m"
                self.doubtful[target.name] = unsure
            return True
        return False

    def _told(self, seen: Experience, matches: Sequence[Match]) -> list[Match]:
        """Those that are told for certain by who is off by as much as it doubts: here nobody is off."""
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
        """Return whether a node is in sight from anywhere: robots leave the straight way, and begin beside it."""
        return any(
            self._is_clear(place, thing)
            for thing in _things(target)
            if isinstance(thing, Landmark)
            for place in self._places(thing, self._near_m(target))
        )

    def _why_not_shown(self, target: Node, passed: Sequence[Experience]) -> str:
        """Why scans that have a node in sight do not show it, or "": of a door both jambs may be out of range.

        Args:
            passed: on the straight way.
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
        return f"scans show it from {shown_m2:.1f} m2 of floor, and robots come by {SHOWN_M2:g} m2"

    def _shown_m2(self, thing: Landmark, near_m: float) -> float:
        """How large the floor is from which a scan shows a landmark; no more than is enough."""
        assert self.looks is not None, "asked where there is a plan"
        shown_m2, places = 0.0, list(self._places(thing, near_m))
        for i in range(EVERY):  # the first of them may be in a corner
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
        """Return whether no wall is between, but the one that it is in."""
        away = math.dist(eye, (thing.x_m, thing.y_m))
        share = max(0.0, 1 - BEFORE_M / max(away, BEFORE_M))
        place = eye[0] + share * (thing.x_m - eye[0]), eye[1] + share * (thing.y_m - eye[1])
        return self.plan is None or self.plan.sees(eye, place)


def _pose(seen: Experience) -> tuple[float, float, float]:
    return seen.x_m, seen.y_m, seen.heading_rad


def _things(node: Node) -> list[Landmark | Position]:
    return [thing for alias in node.see for thing in alias if isinstance(thing, Landmark | Position)]
