"""`phalanx mission audit`: report how hard a captured mission is to read, and whether robots can follow it."""

from __future__ import annotations

import math
import random
from dataclasses import asdict, replace
from typing import Any

import click

from phalanx.cli.terminal import Progress, end_status_line, print_json
from phalanx.config.lidar import LidarConfig
from phalanx.errors import UsageError
from phalanx.mission import BuildOptions, Mission, Profile, build
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.worth.audit import Audit, Rates, audit_in
from phalanx.mission.worth.guessing import OUT_OF_REACH
from phalanx.mission.worth.outlook import time_limit_s
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.report import summary
from phalanx.world.missions.run import run_mission

from .author import checked, explored
from .crack import span
from .draw import NOISE
from .files import building

# Fields of a run's summary, named as in `phalanx mission run --json`.
LIVED = ("decoded", "nodes", "false_fixes", "false_decodes", "pose_error_m_max", "t_s")


def print_audit(
    source: str | None,
    profile: str,
    plan: str | None,
    start: str | None,
    doors: str | None,
    lidar: str,
    open_start: bool,
    offset_mm: int,
    trial: int | None,
    as_json: bool,
) -> None:
    """Print the attacker's and the robot's work at most, warnings, and nodes that no robot can reach."""
    rates, form, scanner = Rates(), Profile[profile.upper()], LidarConfig.parse(lidar)
    if source is None:
        mission, floor = explored(plan, start, "audit", doors, scanner)
    else:
        mission, floor = checked(source, plan, start, doors), None
    name = plan or mission.floor_plan
    if floor is None and name:
        floor = building(name, doors, swept=True)
    if trial and floor is None:
        raise UsageError("no map to run the mission in", "use --map MAP, or map: NAME in the mission")
    report = audit_in(floor, mission, form, open_start=open_start, rates=rates, offset_mm=offset_mm, lidar=scanner)
    options = BuildOptions(profile=form, offset_mm=offset_mm)
    trials = None
    if trial and floor:
        # With dust: it may be an obstacle.
        trials = _run_trials(mission, options, replace(building(name, doors), start=floor.start), scanner, trial)
    if as_json:
        print_json({**report.to_json(), "rates": asdict(rates), "trial": trials})
        return
    _show(report, rates)
    if trials is not None:
        click.echo(
            f"ran {trials['times']} times: {trials['completed']} completed   {trials['false_fixes']} false fixes   "
            f"{trials['false_decodes']} false decodes   worst pose error {trials['pose_error_m_max']:.2f} m"
        )
        for row in trials["runs"]:
            if row["end"]:
                click.echo(f"seed {row['seed']:<4} {row['decoded']} of {row['nodes']} nodes   {row['end']}")


def _show(report: Audit, rates: Rates) -> None:
    click.echo(f"{'node':16}{'at most':>12}{'one core':>12}{'one GPU':>12}{'with map':>12}{'robot':>10}")
    for row in report.nodes:
        far = row.candidates >= OUT_OF_REACH
        cells = ["> 2^128", "-", "-"] if far else [f"{row.candidates:.3g}", span(row.core_s), span(row.gpu_s)]
        cells.append("-" if far or row.by_plan is None else f"{row.by_plan:.3g}")
        findings = [*(f"infeasible {reason}" for reason in row.infeasible), *row.problems]
        problems = f"   {'; '.join(findings)}" if findings else ""
        click.echo(f"{row.name:16}{''.join(f'{cell:>12}' for cell in cells)}{row.robot_ms:>7.1f} ms{problems}")
    for label, costs_s in (
        ("all readable nodes, at most", (report.core_s, report.gpu_s)),
        ("same, nearest places first", (report.nearest_core_s, report.nearest_gpu_s)),
        ("same, with the map", (report.plan_core_s, report.plan_gpu_s)),
    ):
        cells = ["-" if cost_s is None else span(cost_s) if math.isfinite(cost_s) else "-" for cost_s in costs_s]
        click.echo(f"{label:32}{cells[0]:>12}{cells[1]:>12}")
    for problem in report.problems:
        click.echo(f"note: {problem}")
    click.echo(
        f"assumed: {rates.hash_core:.2g} hashes/s on a core, {rates.hash_gpu:.2g} on a GPU; "
        f"{rates.kdf_core:.3g} KDFs/s (N = 2^12, r = 8) on a core, {rates.kdf_gpu:.3g} on a GPU"
    )


def _run_trials(
    mission: Mission, options: BuildOptions, plan: FloorPlan, lidar: LidarConfig, times: int
) -> dict[str, Any]:
    """Return the outcomes of `times` runs of a mission, with a robot for each of its parts."""
    draws = random.Random(0).randbytes  # noqa: S311  # the secrets of a simulation protect nothing
    orders = orders_of(mission, build(mission, options, draws), plan)
    limit_s = time_limit_s(mission, options.profile)
    rows: list[dict[str, Any]] = []
    progress = Progress()
    for seed in range(times):
        run = orders.run(noise=NOISE, lidar=lidar, seed=seed, duration_s=limit_s)
        reports = run_mission(
            run,
            on_progress=lambda share: progress.tell(f"ran {len(rows)} of {times} times", (len(rows) + share) / times),
        )
        figures = summary(run, reports)
        undone = [report for report in reports if not report.done]
        end = next((report.not_validated[-1][1] for report in undone if report.not_validated), "out of time")
        rows.append({"seed": seed, "end": end if undone else "", **{name: figures[name] for name in LIVED}})
    end_status_line()
    return {
        "times": times,
        "completed": sum(not row["end"] for row in rows),
        "false_fixes": sum(row["false_fixes"] for row in rows),
        "false_decodes": sum(row["false_decodes"] for row in rows),
        "pose_error_m_max": max(row["pose_error_m_max"] for row in rows),
        "limit_s": limit_s,
        "runs": rows,
    }
