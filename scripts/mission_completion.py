"""Run missions in many buildings and count completed missions, false fixes and false decodes.

    python scripts/mission_completion.py [WHERE...] [--profile paper,sealed] [--noise stage,fixed,step]
                                         [--people 0,3] [--seeds 10] [--csv out/missions.csv] [--table]

WHERE is a built-in map, one of tests/data/maps, a YAML file, `drawn:7`, or buildings from one seed to another:
`drawn:0-199`, `drawn:flat:0-9`. The mission is that of `phalanx mission build --map`. A built-in mission runs in its
own map. Without WHERE, seven maps and 200 drawn buildings run, as in the long form of `make bench`; that takes hours.

Each finished run is appended to the CSV and is not repeated: after Ctrl-C, the same command continues. Begin another
file after a change of the robot's code. The exit code is 1 if a fix or a decoded node was false.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from itertools import groupby, product
from multiprocessing import get_context
from pathlib import Path

from phalanx.cli.mission.files import read_plain
from phalanx.config.builtin import built_in
from phalanx.errors import UsageError
from phalanx.mission import BuildOptions, Mission, Profile, build
from phalanx.mission.authoring.survey import most_spacious_start, survey, with_start
from phalanx.mission.file import sealed
from phalanx.mission.worth.outlook import time_limit_s
from phalanx.world.building.floorplan import FloorPlan, load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions.orders import Orders, orders_of
from phalanx.world.missions.report import summary
from phalanx.world.missions.run import run_mission

ELSEWHERE = Path(__file__).parent.parent / "tests" / "data" / "maps"
MAPS = (
    "nav2_depot", "nav2_warehouse", "nav2_tb3_sandbox", "aws_small_house", "willow-full", "office_40x40",
    "office_30x25",
)  # fmt: skip
DRAWN = "drawn:0-199"
SIGMAS = "0.03,0.05"
DENIED_KEPT = 6
# Robots of many seeds try the same keys: results of scrypt are cached here, 200 bytes each.
sealed.scrypt = lru_cache(maxsize=1 << 18)(sealed.scrypt)


@dataclass(frozen=True, slots=True)
class Case:
    """Parameters of one run."""

    where: str
    profile: str
    noise: str
    people: int
    seed: int


@dataclass(frozen=True, slots=True)
class Row(Case):
    """Result of one run."""

    completed: int
    decoded: int
    nodes: int
    false_fixes: int
    false_decodes: int
    pose_error_m: float  # the worst
    odometry_error_m: float  # the worst
    t_s: float
    limit_s: float
    end: str  # why it did not complete, or ""
    not_validated: str  # reason -> count
    denied: str  # the first false fixes and nodes: time, kind, reason
    digest: str
    wall_s: float


def words() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("where", nargs="*")
    parser.add_argument("--profile", default="paper")
    parser.add_argument("--noise", default="stage", help=f"models, each with ({SIGMAS})")
    parser.add_argument("--people", default="0")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--csv", type=Path, default=Path("out/missions.csv"))
    parser.add_argument("--table", action="store_true", help="print the table of the CSV without running anything")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    return parser.parse_args()


def cases_of(said: argparse.Namespace) -> list[Case]:
    """Return all requested runs, by seed and then by building. Raises: UsageError."""
    if not said.where:
        seeds = range(said.first, said.first + max(10, said.seeds))
        maps = product(seeds, MAPS, ("paper", "sealed"), ("stage", "fixed", "step"), (0, 3))
        drawn = product((0,), wheres_of([DRAWN]), ("paper",), ("stage",), (0,))
        return [Case(*each, seed) for seed, *each in (*maps, *drawn)]
    seeds = range(said.first, said.first + said.seeds)
    profiles, noises = said.profile.split(","), said.noise.split(",")
    for profile in profiles:
        if profile.upper() not in Profile.__members__:
            raise UsageError(f"no profile {profile!r}", "paper, sealed")
    for noise in noises:
        OdometryNoise.parse(f"{SIGMAS},{noise}")
    people = [int(count) for count in said.people.split(",")]
    wheres = list(wheres_of(said.where))
    return [Case(*each, seed) for seed, *each in product(seeds, wheres, profiles, noises, people)]


def wheres_of(names: Iterable[str]) -> Iterator[str]:
    """Return the building names, with ranges expanded."""
    for name in names:
        drawn = re.fullmatch(r"(drawn:(?:[a-z]+:)?)(\d+)-(\d+)", name)
        if drawn:
            yield from (f"{drawn[1]}{seed}" for seed in range(int(drawn[2]), int(drawn[3]) + 1))
        else:
            yield name


@lru_cache(maxsize=64)
def mission_in(where: str) -> tuple[Mission, FloorPlan]:
    """Return the mission of a building, and the building. Raises: UsageError: there is no mission."""
    if where in built_in("missions"):
        plain = read_plain(where)
        return plain, load_floorplan(plain.floor_plan)
    there = ELSEWHERE / f"{where}.yaml"
    name = there if there.exists() else where
    plan = load_floorplan(name)
    plan = plan if plan.start is not None else with_start(plan, most_spacious_start(plan))
    return survey(replace(load_floorplan(name, swept=True), start=plan.start)), plan


@lru_cache(maxsize=64)
def orders(where: str, profile: str) -> tuple[Orders, float]:
    """Return the encoded mission of a building and its time limit, s. Raises: UsageError: there is no mission."""
    plain, plan = mission_in(where)
    form = Profile[profile.upper()]
    built = build(plain, BuildOptions(profile=form), random.Random(0).randbytes)  # noqa: S311
    return orders_of(plain, built, plan), time_limit_s(plain, form)


def lived(case: Case) -> Row:
    """Run a case and return its result."""
    began = time.perf_counter()

    def row(**more: object) -> Row:
        empty = {field.name: "" if field.type == "str" else 0 for field in fields(Row)}
        return Row(**{**empty, **asdict(case), "wall_s": round(time.perf_counter() - began, 1), **more})

    try:
        given, limit = orders(case.where, case.profile)
    except UsageError as error:
        return row(end=f"no mission: {error}")
    noise = OdometryNoise.parse(f"{SIGMAS},{case.noise}")
    run = given.run(noise=noise, people=case.people, seed=case.seed, duration_s=limit)
    reports = run_mission(run)
    told = summary(run, reports)
    whys = Counter(each["reason"] for each in told["not_validated"])
    done = told["completed"] == told["robots"]
    return row(
        completed=int(done),
        **{name: told[name] for name in ("decoded", "nodes", "false_fixes", "false_decodes", "t_s", "digest")},
        pose_error_m=told["pose_error_m_max"],
        odometry_error_m=told["odometry_error_m_max"],
        limit_s=limit,
        end="" if done else next(report.not_validated[-1][1] for report in reports if not report.done),
        not_validated="; ".join(f"{why} {count}" for why, count in whys.items()),
        denied="; ".join(f"{t_s:.0f} s {what} {why}" for report in reports for t_s, what, why in first(report.denied)),
    )


def first(denied: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Return all false nodes and the first false fixes."""
    nodes = [each for each in denied if each[1] != "fix"]
    return sorted([*nodes[:DENIED_KEPT], *[each for each in denied if each[1] == "fix"][:DENIED_KEPT]])


def kept(path: Path) -> list[Row]:
    """Return the rows of a file without an incomplete last one. Raises: UsageError: not such a file."""
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    if not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
        path.write_text(text, encoding="utf-8")
    lines = list(csv.reader(text.splitlines()))
    head = [field.name for field in fields(Row)]
    if lines and (lines[0] != head or any(len(line) != len(head) for line in lines)):
        raise UsageError(f"{path} is not a table of missions of this version", "use another file for --csv")
    makes = {"str": str, "int": int, "float": float}
    return [
        Row(**{each.name: makes[str(each.type)](cell) for each, cell in zip(fields(Row), line, strict=True)})
        for line in lines[1:]
    ]


def live(cases: list[Case], path: Path, workers: int) -> list[Row]:
    """Run cases, append each result to the file, and return the results, also after Ctrl-C."""
    rows: list[Row] = []
    path.parent.mkdir(parents=True, exist_ok=True)
    is_new = not path.exists() or not path.stat().st_size
    with (
        path.open("a", encoding="utf-8", newline="") as file,
        # Only this process handles Ctrl-C; leaving the block ends the others.
        get_context("spawn").Pool(workers, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool,
    ):
        table = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        if is_new:
            table.writeheader()
        try:
            for row in pool.imap_unordered(lived, cases):
                rows.append(row)
                table.writerow(asdict(row))
                file.flush()
                print(f"{len(rows)}/{len(cases)}  {told(row)}", flush=True)
        except KeyboardInterrupt:
            print(f"stopped; {len(cases) - len(rows)} of {len(cases)} runs are left", file=sys.stderr)
    return rows


def told(row: Row) -> str:
    """Return a run's result as one line."""
    return (
        f"{row.where} {row.profile} {row.noise} {row.people} people seed {row.seed}: {row.decoded}/{row.nodes} nodes, "
        f"{row.t_s:.0f} of {row.limit_s:.0f} s, {row.false_fixes} false fixes, {row.false_decodes} false decodes, "
        f"worst {row.pose_error_m:.2f} m{f', {row.end}' if row.end else ''} ({row.wall_s:.0f} s)"
    )


def print_table(rows: list[Row]) -> None:
    """Print the results by building (drawn ones by kind), profile, noise and people."""

    def key(row: Row) -> tuple[str, str, str, int]:
        name = "drawn" if row.where.startswith("drawn:") else row.where
        return name, row.profile, row.noise, row.people

    print(
        f"\n{'where':18} {'profile':8} {'noise':6} {'people':>6} {'completed':>10} {'false fixes':>16} "
        f"{'false decodes':>16} {'worst':>8}  not completed"
    )
    for (where, profile, noise, people), group in groupby(sorted(rows, key=key), key):
        runs = list(group)
        ends = Counter(run.end for run in runs if run.end)
        fixes, decodes = (
            f"{sum(counts)} in {sum(count > 0 for count in counts)}"
            for counts in ([run.false_fixes for run in runs], [run.false_decodes for run in runs])
        )
        print(
            f"{where:18} {profile:8} {noise:6} {people:6} {sum(run.completed for run in runs):4} of {len(runs):2} "
            f"{fixes:>16} {decodes:>16} {max(run.pose_error_m for run in runs):6.2f} m  "
            f"{', '.join(f'{end} {count}' for end, count in ends.most_common())}"
        )


def main() -> int:
    """Run the requested cases that are not in the file yet, and print the table of all."""
    said = words()
    try:
        before, asked = kept(said.csv), cases_of(said)
    except (UsageError, ValueError) as error:
        print(f"{error}", file=sys.stderr)
        return 2
    names = [field.name for field in fields(Case)]
    known = {Case(*(getattr(row, name) for name in names)) for row in before}
    left = [] if said.table else [case for case in asked if case not in known]
    rows = before + (live(left, said.csv, min(said.workers, len(left))) if left else [])
    wanted = set(asked)
    rows = [row for row in rows if said.table or Case(*(getattr(row, name) for name in names)) in wanted]
    print_table(rows)
    return 1 if any(row.false_fixes or row.false_decodes for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
