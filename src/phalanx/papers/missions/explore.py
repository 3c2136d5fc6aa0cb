"""Encoded graphs Fig. 9 and Table I: four robots that explore the office together and share only hashes.

All robots start at the main door. Planning needs no secret: the public graph is divided into four shares, and each
robot visits its own share first. Robots that meet prove to each other which nodes they decoded; raw sensor data stays
with each robot. A run ends when the team has decoded every node.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from phalanx.mission import BuildOptions, Profile, Walker, build
from phalanx.mission.landmarks import FloorPlan
from phalanx.papers.statement import Statement, quantiles
from phalanx.papers.table import Rows, Table, by_seed, seed_of
from phalanx.world.building.floorplan import DEFAULT, load_floorplan
from phalanx.world.building.odometry import NoiseModel, OdometryNoise
from phalanx.world.missions.setup import MissionRun, Part
from phalanx.world.missions.world import STEP_S, MissionRobot, MissionWorld

from .drive import office

ROBOTS = 4
MEET_M = 6.0
LIMIT_S = 900.0
NOISE = OdometryNoise(0.03, 0.05, NoiseModel.STAGE)
SAMPLE_TICKS = 10
CELL_M = 0.5
# Floor that the lidar sweeps within this range counts as raw data; the paper does not define how it counts.
KNOWS_M = 5.0
COLUMNS = ("t_s", "robot", "x_m", "y_m", "found", "told", "area", "error_m", "team")
LANDMARKS = 32
TEAM, ERROR, TOLD = COLUMNS.index("team"), COLUMNS.index("error_m"), COLUMNS.index("told")
# Robots in the paper's order: purple, orange, red, cyan.
PAPER_FOUND = (12, 16, 15, 11)
PAPER_AREA_PCT = (23, 29, 41, 27)
FOUND, AREA = COLUMNS.index("found"), COLUMNS.index("area")


def measure_case(case: str, _tell: object = None) -> Rows:
    """Run one seed; return a row for each robot and sample.

    Columns: found: landmarks that the robot decoded; told: further landmarks that others proved; area: share of the
    free floor of which the robot has raw data; error_m: of its pose; team: landmarks that any robot decoded.
    """
    seed = seed_of(case)
    plan = load_floorplan(DEFAULT)
    assert plan.start is not None, "the default floor plan has a start pose"
    walker = _walker()
    part = Part(walker.mission, None, plan.start)
    run = MissionRun(plan=plan, parts=(part,), robots=ROBOTS, noise=NOISE, seed=seed, meet_m=MEET_M)
    world = MissionWorld(run, walkers=[walker])
    robots = world.robots
    shares = shares_of(walker)
    all_nodes = frozenset().union(*shares)
    for robot, share in zip(robots, shares, strict=True):
        _set_others(robot, all_nodes - share)
    proved: list[set[int]] = [set() for _ in robots]
    floor = _floor(plan)
    known = np.zeros((ROBOTS, len(floor)), bool)
    rows = []
    for tick in range(round(LIMIT_S / STEP_S)):
        for k, robot in enumerate(robots):
            if shares[k] != all_nodes and _has_done(robot, shares[k]):
                # Its own share is done: go on to every node that no other robot has proved.
                shares[k] = all_nodes
                _set_others(robot, frozenset(proved[k]))
        found_by_all = frozenset().union(*map(_found, robots))
        for robot, share in zip(robots, shares, strict=True):
            robot.rests = found_by_all == all_nodes or _has_done(robot, share)
        busy = not all(robot.rests for robot in robots)
        world.advance((tick + 1) * STEP_S)
        for robot, proofs in world.meet():
            proved[robot.number] |= {node for node, _ in proofs}
        if busy and tick % SAMPLE_TICKS:
            continue
        team = frozenset().union(*map(_found, robots)) - _starts(walker)
        for robot, others in zip(robots, proved, strict=True):
            number = robot.number
            known[number] |= _seen(robot, floor)
            x, y, _ = robot.body.wheels.pose
            found = _found(robot) - _starts(walker)
            more = others - _found(robot) - _starts(walker)
            error = robot.report.pose_error_m[-1]
            rows.append((tick * STEP_S, number, x, y, len(found), len(more), known[number].mean(), error, len(team)))
        if not busy:
            break
    return np.array(rows)


@lru_cache(maxsize=1)
def _walker() -> Walker:
    built = build(office(), BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)[0]  # noqa: S311
    return Walker(built.mission, built.key)


def shares_of(walker: Walker) -> list[frozenset[int]]:
    """Divide the nodes evenly among the robots, around ROBOTS nodes that are far from each other in hops.

    Source: Encoded graphs §VI-E: plans are shared, and they use the navigation graph only.
    """
    count = len(walker.mission.nodes)
    hops = [walker.map.distances(node, range(count), {}, ())[0] for node in range(count)]
    centres: list[int] = []
    for _ in range(ROBOTS):
        # The first centre is far from the start, each further one far from the chosen ones.
        chosen = centres or [0]
        centres.append(max(range(count), key=lambda node: (min(hops[c][node] for c in chosen), -node)))
    owner: dict[int, int] = {}
    for _, node, k in sorted(
        (hops[centre][node], node, k) for k, centre in enumerate(centres) for node in range(count)
    ):
        if node not in owner and list(owner.values()).count(k) < math.ceil(count / ROBOTS):
            owner[node] = k
    return [frozenset(node for node in owner if owner[node] == k) for k in range(ROBOTS)]


def _starts(walker: Walker) -> frozenset[int]:
    """Return the nodes that are not landmarks."""
    return frozenset(range(len(walker.mission.nodes) - LANDMARKS))


def _has_done(robot: MissionRobot, share: frozenset[int]) -> bool:
    return robot.controller.over or share <= _found(robot) | robot.controller.memory.walk.others


def _found(robot: MissionRobot) -> frozenset[int]:
    return frozenset(robot.controller.memory.walk.opened)


def _set_others(robot: MissionRobot, others: frozenset[int]) -> None:
    """Set the nodes that the robot believes to be decoded by others."""
    memory = robot.controller.memory
    robot.controller.memory = replace(memory, walk=replace(memory.walk, others=others))


def _floor(plan: FloorPlan) -> NDArray[np.float64]:
    """Return (k, 2) centres of the cells of free floor."""
    x0, y0, x1, y1 = plan.bounds
    xs, ys = (np.arange(low + CELL_M / 2, high, CELL_M).tolist() for low, high in ((x0, x1), (y0, y1)))
    return np.array([(x, y) for x in xs for y in ys if plan.inside(x, y)])


def _seen(robot: MissionRobot, floor: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (k,) flags of the floor cells that the robot's lidar sweeps within KNOWS_M."""
    lidar, pose = robot.body.building.lidar, robot.body.wheels.pose
    config, (x, y, heading) = lidar.config, pose
    ranges = lidar.true_ranges(pose)
    away = np.hypot(floor[:, 0] - x, floor[:, 1] - y)
    bearing = np.arctan2(floor[:, 1] - y, floor[:, 0] - x) - heading
    beam = ((bearing - config.angle_min_rad) % math.tau / config.angle_increment_rad).astype(int)
    swept = beam < config.beams
    seen: NDArray[np.bool_] = (away <= KNOWS_M) & swept & (away < ranges[np.where(swept, beam, 0)])
    return seen


def ends(table_case: Rows) -> Rows:
    """Return (ROBOTS, columns), the last row of each robot."""
    return np.array([table_case[table_case[:, 1] == number][-1] for number in range(ROBOTS)])


def compare_fig9(table: Table) -> list[Statement]:
    """Compare our measurements with the statements about Fig. 9 in §VI-C."""
    last = [ends(rows) for rows in table.cases.values()]
    team = np.array([rows[:, TEAM].max() for rows in last])
    received = np.array([np.count_nonzero(rows[:, TOLD]) for rows in last], float)
    errors_m = np.array([rows[:, ERROR].max() for rows in table.cases.values()])
    return [
        Statement(
            what=f"landmarks of {LANDMARKS} that the team found",
            paper="the environment is explored",
            ours=quantiles(team, ".0f"),
            agrees=bool(np.all(team == LANDMARKS)),
            why="all, in every seed",
        ),
        Statement(
            what=f"robots of {ROBOTS} that received hashes from another robot",
            paper="share their progress upon meeting",
            ours=quantiles(received, ".0f"),
            agrees=bool(np.all(received >= 2)),
            why="at least one meeting in every seed",
        ),
        Statement(
            what="largest error of any robot's pose, m",
            ours=quantiles(errors_m, ".2f"),
            agrees=bool(np.all(errors_m < 0.5)),
            why="within the paper's search of ±0.5 m at all times; Stage-type noise (0.03, 0.05)",
        ),
    ]


def values_at_end(table: Table, column: int) -> Rows:
    """Return (seeds, ROBOTS) final values of a column, sorted within each seed because robots are interchangeable."""
    return np.sort([ends(rows)[:, column] for rows in table.cases.values()], axis=1)


def compare_table1(table: Table) -> list[Statement]:
    """Compare Table I with our robots, by rank."""
    out, area_pct = [], 100 * values_at_end(table, AREA)
    for quantity, papers, ours, near, why in (
        (
            f"hashes found of {LANDMARKS}",
            PAPER_FOUND,
            values_at_end(table, FOUND),
            2,
            "the paper's routes are not known",
        ),
        (
            "area known, %",
            PAPER_AREA_PCT,
            area_pct,
            10,
            f"floor swept within {KNOWS_M:g} m; the paper does not define how it counts",
        ),
    ):
        out += [
            Statement(
                what=f"{quantity}, robot {rank + 1} by rank",
                paper=str(paper),
                ours=quantiles(ours[:, rank], ".0f"),
                agrees=abs(float(np.median(ours[:, rank])) - paper) <= near,
                why=f"median within {near}: {why}",
            )
            for rank, paper in enumerate(sorted(papers))
        ]
    most = area_pct.max(axis=1)
    out.append(
        Statement(
            what="most raw knowledge of one robot, %",
            paper="41",
            ours=quantiles(most, ".0f"),
            agrees=bool(np.all(most <= max(PAPER_AREA_PCT))),
            why="no more than the paper's, in every seed",
        )
    )
    return out


FIG9, TABLE1 = (
    SimpleNamespace(COLUMNS=COLUMNS, cases=by_seed, measure_case=measure_case, compare=compare)
    for compare in (compare_fig9, compare_table1)
)
