"""`phalanx mission audit`: what a mission is worth to who captures it, and whether robots can live it."""

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
from phalanx.mission.worth.outlook import time_for_s
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.report import summary
from phalanx.world.missions.run import run_mission

from .author import checked, explored
from .crack import span
from .draw import NOISE
from .files import building

# Of a run, as `phalanx mission run --json` names it.
LIVED = ("decoded", "nodes", "false_fixes", "false_decodes", "pose_error_m_max", "t_s")


def tell_worth(
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
    """Prints what an attacker must try at most, what the robot must, what looks wrong, and what no robot can live."""
    rates, form, eye = Rates(), Profile[profile.upper()], LidarConfig.parse(lidar)
    if source is None:
        told, floor = explored(plan, start, "audit", doors, eye)
    else:
        told, floor = checked(source, plan, start, doors), None
    name = plan or told.floor_plan
    if floor is None and name:
        floor = building(name, doors, swept=True)
    if trial and floor is None:
        raise UsageError("no map to run the mission in", "--map MAP, or map: NAME in the mission")
    report = audit_in(floor, told, form, open_start=open_start, rates=rates, offset_mm=offset_mm, lidar=eye)
    options = BuildOptions(profile=form, offset_mm=offset_mm)
    lived = None
    if trial and floor:
        # Where the map has dust, something may stand.
        lived = _lived(told, options, replace(building(name, doors), start=floor.start), eye, trial)
    if as_json:
        print_json({**report.told(), "rates": asdict(rates), "trial": lived})
        return
    _show(report, rates)
    if lived is not None:
        click.echo(
            f"ran {lived['times']} times: {lived['completed']} completed   {lived['false_fixes']} false fixes   "
            f"{lived['false_decodes']} false decodes   worst pose error {lived['pose_error_m_max']:.2f} m"
        )
        for row in lived["runs"]:
            if row["end"]:
                click.echo(f"seed {row['seed']:<4} {row['decoded']} of {row['nodes']} nodes   {row['end']}")


def _show(report: Audit, rates: Rates) -> None:
    click.echo(f"{'node':16}{'at most':>12}{'one core':>12}{'one GPU':>12}{'with map':>12}{'robot':>10}")
    for row in report.nodes:
        far = row.candidates >= OUT_OF_REACH
        cells = ["> 2^128", "-", "-"] if far else [f"{row.candidates:.3g}", span(row.core_s), span(row.gpu_s)]
        cells.append("-" if far or row.by_plan is None else f"{row.by_plan:.3g}")
        looks = [*(f"infeasible {reason}" for reason in row.infeasible), *row.problems]
        problems = f"   {'; '.join(looks)}" if looks else ""
        click.echo(f"{row.name:16}{''.join(f'{cell:>12}' for cell in cells)}{row.robot_ms:>7.1f} ms{problems}")
    for who, costs_s in (
        ("all that can be opened, at most", (report.core_s, report.gpu_s)),
        ("likewise, nearest first", (report.nearest_core_s, report.nearest_gpu_s)),
        ("likewise with the map", (report.plan_core_s, report.plan_gpu_s)),
    ):
        cells = ["-" if cost_s is None else span(cost_s) if math.isfinite(cost_s) else "-" for cost_s in costs_s]
        click.echo(f"{who:32}{cells[0]:>12}{cells[1]:>12}")
    for problem in report.problems:
        click.echo(f"note: {problem}")
    click.echo(
        f"assumed: {rates.hash_core:.2g} hashes/s on a core, {rates.hash_gpu:.2g} on a GPU; "
        f"{rates.kdf_core:.3g} KDFs/s (N = 2^12, r = 8) on a core, {rates.kdf_gpu:.3g} on a GPU"
    )


def _lived(told: Mission, options: BuildOptions, plan: FloorPlan, lidar: LidarConfig, times: int) -> dict[str, Any]:
    """What became of a mission that was lived so often, by a robot for each of its parts."""
    draws = random.Random(0).randbytes  # noqa: S311  # a simulation's secrets keep nobody out
    orders = orders_of(told, build(told, options, draws), plan)
    limit_s = time_for_s(told, options.profile)
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
