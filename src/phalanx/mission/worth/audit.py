"""Compute upper bounds of the tries that open each node of a captured file, given what the previous node reveals.

The costs of guessing add up from node to node and do not multiply: an opened node reveals the direction of the next.
Only secrets that a floor plan does not show (a start key, a message, a random token) are out of reach. The counts are
for opening nodes; mere places can be found with the floor plan and no key (docs/explanation/threats-missions.md).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission.authoring.compiling import PAPER_CODING, SEALED_CODING, alias_offset, place_of
from phalanx.mission.file.canonical import Shape, shape_of
from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission, Node
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.observable import MM_PER_M, Landmark, cell_of
from phalanx.mission.walk.cells import BIN_STEPS, RINGS
from phalanx.mission.walk.search import WINDOWS

from .feasible import look_ahead
from .guessing import OUT_OF_REACH, Alias, Guess, landmark_of
from .outlook import Outlook
from .shown import PlanCandidates, candidates_in

PAPER_SCRYPT = 8 << 12  # N * r for which the rates of scrypt are given


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """Tries per second of an attacker. The defaults are assumptions and are printed; `crack` measures one core."""

    hash_core: float = 1.4e7  # SHA3-256 of one short message (hashcat 17400 on one RTX 4090)
    hash_gpu: float = 5e9  # likewise
    kdf_core: float = 100.0  # scrypt with N = 2^12, r = 8 (hashcat 8900, scaled from N = 2^14)
    kdf_gpu: float = 28_000.0  # likewise


@dataclass(frozen=True, slots=True)
class NodeAudit:
    """Result of the audit for one node."""

    name: str
    candidates: float  # upper bound of tries, for the alias with the fewest; a better order needs fewer
    nearest: float  # likewise, in order of distance from the previous node
    by_plan: float | None  # likewise, with the floor plan, best candidates first; None without a plan
    core_s: float  # time for all candidates on one core
    gpu_s: float  # time for all candidates on one GPU
    robot_ms: float  # the robot's own worst search for one landmark in view, on one core
    problems: tuple[str, ...]  # hints for the author
    infeasible: tuple[str, ...]  # reasons why no robot can be expected to decode it; empty if one can


@dataclass(frozen=True, slots=True)
class Audit:
    """Result of the audit; costs are sums over the nodes that guessing can reach, infinite if there are none."""

    nodes: tuple[NodeAudit, ...]
    core_s: float
    gpu_s: float
    nearest_core_s: float  # in order of distance
    nearest_gpu_s: float  # likewise
    plan_core_s: float | None  # with the floor plan
    plan_gpu_s: float | None  # likewise
    robot_ms: float
    out_of_reach: int
    problems: tuple[str, ...]
    feasible: bool | None  # True if robots can be expected to complete the mission; None if not predicted

    def to_json(self) -> dict[str, Any]:
        """Return the audit as a JSON-ready dict."""
        rows = [{**asdict(row), "out_of_reach": row.candidates >= OUT_OF_REACH} for row in self.nodes]
        # JSON has no infinity, and 0 would mean that cracking is free: use null.
        costs = {name: cost_s for name, cost_s in asdict(self).items() if name.endswith("_s")}
        endless = {name: None for name, cost_s in costs.items() if cost_s is not None and math.isinf(cost_s)}
        return {**asdict(self), **endless, "nodes": rows}


def audit_in(
    floor: FloorPlan | None,
    mission: Mission,
    profile: Profile,
    *,
    open_start: bool = False,
    rates: Rates | None = None,
    offset_mm: int = 1,
    lidar: LidarConfig | None = None,
) -> Audit:
    """Audit a mission against an attacker who has the building's floor plan; None is an unknown building.

    Args:
        open_start, rates: as in `audit`.
        offset_mm: the compiler rounds offsets to multiples of this.
    """
    return audit(
        mission,
        profile,
        open_start=open_start,
        rates=rates,
        plan=candidates_in(floor, offset_mm) if floor else None,
        outlook=look_ahead(mission, None, floor, lidar),
        doors=floor.extraction if floor else None,
    )


def audit(
    mission: Mission,
    profile: Profile,
    *,
    open_start: bool = False,
    config: MissionConfig | None = None,
    rates: Rates | None = None,
    plan: PlanCandidates | None = None,
    outlook: Outlook | None = None,
    doors: ExtractionConfig | None = None,
) -> Audit:
    """Estimate the tries to open a captured file, and list problems for the author.

    Args:
        open_start: the attacker has the start key (it is in the file, or was captured with the robot).
        plan: candidates from the building's floor plan, for an attacker who has it.
        outlook: prediction of the robots' run.
        doors: limits of the doors that robots recognise in that building; default: those of the paper.
    Source: docs/spec/mission.md; Encoded graphs §VI-G.
    """
    config, rates = config or MissionConfig(), rates or Rates()
    coding = mission.coding or (PAPER_CODING if profile is Profile.PAPER else SEALED_CODING)
    scale = PAPER_SCRYPT / (coding.kdf_r << coding.kdf_log2_n)
    paper = profile is Profile.PAPER
    core = rates.hash_core if paper else rates.kdf_core * scale
    gpu = rates.hash_gpu if paper else rates.kdf_gpu * scale
    guess = Guess(mission, coding, profile, open_start, plan)
    problems = _problems(mission, coding, config, doors or ExtractionConfig())
    outlook, feasible = (Outlook({}, {}), None) if outlook is None else (outlook, outlook.completes(mission))
    rows = []
    for node in mission.nodes:
        count = guess.candidates(node)
        own = max(_robot_tries(coding, config, alias, node, len(guess.actions)) for alias in node.see)
        rows.append(
            NodeAudit(
                node.name,
                count,
                guess.candidates(node, nearest=True),
                guess.by_plan(node),
                count / core,
                count / gpu,
                1000 * own / core,
                (*problems.get(node.name, ()), *filter(None, [outlook.doubtful.get(node.name)])),
                outlook.infeasible.get(node.name, ()),
            )
        )
    # In the paper profile all nodes can be tried at once; in the sealed profile the attacker begins at a start node.
    shut = {row.name for row in rows if row.candidates >= OUT_OF_REACH}
    open_to_guess = {row.name for row in rows} - shut if paper else _reachable(mission, shut)
    within = [row for row in rows if row.name in open_to_guess]
    tries = sum(row.candidates for row in within) or math.inf
    nearest = sum(row.nearest for row in within) or math.inf
    planned = None if plan is None else sum(row.by_plan or 0.0 for row in within) or math.inf
    general = []
    if paper:
        general.append("paper profile: fast unsalted hashes commit to the mission and do not hide it")
    elif open_start:
        general.append("with the start key anyone who captures the file can start to guess")
    else:
        general.append("without the start key no node can be opened; each row assumes that the previous node is open")
    if not paper:
        general.append(
            "counts are upper bounds, also nearest first: a mission with 28945 tries at most, and 5288 nearest first, "
            "was opened with 1555 tries in a better order"
        )
        general.append(
            "with the floor plan and no key, the places of nearly all nodes can be found in seconds to a minute: "
            "repeat the survey of build --map, or match the file's graph with the plan"
        )
    if feasible is False:
        general.append("no robot can be expected to complete the mission")
    return Audit(
        tuple(rows),
        tries / core,
        tries / gpu,
        nearest / core,
        nearest / gpu,
        None if planned is None else planned / core,
        None if planned is None else planned / gpu,
        max(row.robot_ms for row in rows),
        len(rows) - len(within),
        tuple(general),
        feasible,
    )


def _robot_tries(coding: CodingConfig, config: MissionConfig, alias: Alias, node: Node, actions: int) -> float:
    shape = shape_of(alias)
    tries = 1.0
    if shape.place:
        # The worst case, a lost robot: the largest search region, and the adjacent bins.
        wanted = math.ceil(config.tolerance_m * MM_PER_M / coding.delta_mm + 0.5) - 1
        tries *= (2 * next((rings for rings in RINGS if rings >= wanted), RINGS[-1]) + 1) ** 2
        tries *= len(BIN_STEPS) if shape.oriented else 1
    tries *= len(WINDOWS) if shape.time else 1
    return tries * (max(1, actions) if node.do else 1)


def _problems(
    mission: Mission, coding: CodingConfig, config: MissionConfig, doors: ExtractionConfig
) -> dict[str, list[str]]:
    """Return problems for the author, by node."""
    out: dict[str, list[str]] = {}

    def tell(name: str, problem: str) -> None:
        if problem not in out.setdefault(name, []):
            out[name].append(problem)

    if len(mission.nodes) == 1:
        tell(mission.nodes[0].name, "the only node: the mission is complete at the start")
    reached = _reachable(mission)
    for node in mission.nodes:
        if node.name not in reached:
            tell(node.name, "unreachable from any start")
        if node.width_m is not None and not doors.door_min_m <= node.width_m <= doors.door_max_m:
            seen = f"robots recognise {doors.door_min_m:g} to {doors.door_max_m:g}"
            tell(node.name, f"a door of {node.width_m:g} m; {seen}")
    for a, mine, b, theirs, away in _near_pairs(mission, coding, config.tolerance_m):
        if _same(mine, theirs, a, b) and _fits(coding, mine, theirs):
            tell(a.name, f"one observation satisfies {b.name} too")
            tell(b.name, f"one observation satisfies {a.name} too")
        else:
            tell(a.name, f"{away:.2f} m from {b.name}, within the search radius of {config.tolerance_m:g} m")
    return out


def _reachable(mission: Mission, shut: Collection[str] = ()) -> set[str]:
    """Return the nodes that can be reached from a start without passing nodes in `shut`."""
    after: dict[str, list[str]] = {}
    for way in mission.ways:
        after.setdefault(way.source, []).append(way.target)
    waiting = deque(node.name for node in mission.nodes if node.start and node.name not in shut)
    reached = set(waiting)
    while waiting:
        for name in after.get(waiting.popleft(), []):
            if name not in reached and name not in shut:
                reached.add(name)
                waiting.append(name)
    return reached


def _near_pairs(
    mission: Mission, coding: CodingConfig, radius_m: float
) -> list[tuple[Node, Alias, Node, Alias, float]]:
    """Return pairs of similar aliases of different nodes within a radius, with their distance; 0 without a place."""
    grid: dict[tuple[Shape, int, int], list[tuple[Node, Alias]]] = {}
    edge = max(radius_m, coding.delta_mm / MM_PER_M, 1e-3)
    pairs = []
    for node in mission.nodes:
        for alias in node.see:
            place, shape = place_of(alias), shape_of(alias)
            x = 0 if place is None else math.floor(place.x_m / edge)
            y = 0 if place is None else math.floor(place.y_m / edge)
            for i in (-1, 0, 1):
                for j in (-1, 0, 1):
                    for other, theirs in grid.get((shape, x + i, y + j), ()):
                        there = place_of(theirs)
                        if other.part != node.part or other is node or not _same(alias, theirs, node, other):
                            continue
                        away = 0.0
                        if place is not None and there is not None:
                            away = math.dist((place.x_m, place.y_m), (there.x_m, there.y_m))
                        if away <= radius_m:
                            pairs.append((node, alias, other, theirs, away))
            grid.setdefault((shape, x, y), []).append((node, alias))
    return pairs


def _same(mine: Alias, theirs: Alias, a: Node, b: Node) -> bool:
    """Return True if two aliases differ only in their places."""
    rest = [
        ({thing for thing in alias if not hasattr(thing, "x_m")}, node.wait, node.do)
        for alias, node in ((mine, a), (theirs, b))
    ]
    one, two = landmark_of(mine), landmark_of(theirs)
    return rest[0] == rest[1] and (one is None or two is None or one.text == two.text)


def _fits(coding: CodingConfig, mine: Alias, theirs: Alias) -> bool:
    """Return True if an observation of one alias lies in the other's cell as well."""
    place = place_of(mine)
    there = place_of(theirs)
    if place is None or there is None:
        return True
    offset = alias_offset(coding, theirs)
    cells = [
        cell_of(coding, offset, thing.x_m, thing.y_m, thing if isinstance(thing, Landmark) else None)
        for thing in (place, there)
    ]
    return cells[0] == cells[1]
