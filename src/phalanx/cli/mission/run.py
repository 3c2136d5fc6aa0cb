"""`phalanx mission run`: robots that know only the encoded graph live a mission in a simulated building."""

from __future__ import annotations

import math
import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from phalanx.cli.terminal import Progress, counted, end_status_line, print_json, stopped, talk
from phalanx.config import BtiConfig
from phalanx.config.lidar import LidarConfig
from phalanx.config.mission import MissionConfig
from phalanx.errors import Unavailable, UsageError
from phalanx.mission import BuildOptions, EncodedMission, Mission, Profile, admit, build
from phalanx.mission.authoring.survey import most_spacious_start
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.observable import LONGEST_S
from phalanx.world.building.floorplan import DEFAULT
from phalanx.world.building.odometry import OdometryNoise, Pose
from phalanx.world.missions.orders import File, orders_of_files
from phalanx.world.missions.recording import write_recording
from phalanx.world.missions.report import Report, format_drift, summary
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.setup import MissionRun, check_count

from .files import Wanted, building, check_folder, parse_robots


def run(
    sources: tuple[str, ...],
    world: str | None,
    doors: str | None,
    lidar: str,
    furnish: str | None,
    robots: int | None,
    named: str,
    noise: str,
    profile: str,
    key: Path | None,
    trust: tuple[str, ...],
    at_s: float | None,
    said_start: str | None,
    strangers: float,
    record: Path | None,
    as_json: bool,
    **how: Any,
) -> int:
    """Runs a mission and prints what became of it; 1 if a robot did not complete it."""
    if record is not None:
        check_folder(record)
    able = {
        "noise": OdometryNoise.parse(noise),
        "lidar": LidarConfig.parse(lidar),
        "config": MissionConfig(strangers_per_m2=strangers),
    }
    files, plain = Wanted(sources, furnish, key, trust, "--key").read()
    ids, count = _fleet(named, robots, len(files or (plain.parts if plain else ())))
    if how["defence"] != "none":  # before anything is encoded
        check_count(count, how["f_max"])
    start = parse_start(said_start) if said_start else None
    name = world or (plain.floor_plan if plain else "")
    plan = _begun(building(name or DEFAULT, doors), told=start is not None)
    if not name:
        talk(f"in {DEFAULT}; --world names another building")
    if plain is not None and not files:
        files = _encoded(plain, profile, how["seed"])
    orders = orders_of_files(Path(sources[0]).stem, files, plan, plain, start)
    begin_s = float(max(encoded.header.valid_from_s for encoded, _ in files)) if at_s is None else at_s
    if not 0 <= begin_s < LONGEST_S:
        raise UsageError(f"--at {begin_s:g}", "seconds since 1970")
    for i, (encoded, _) in enumerate(files):
        _admit(encoded, ids[i :: len(files)], len(range(i, count, len(files))), begin_s)
    setting = orders.run(robots=count, **able, begin_s=begin_s, keep_trace=record is not None, **how)
    _warn_of_few(setting)
    _warn_of_wheels(setting)
    progress = Progress()
    try:
        reports = run_mission(
            setting, os.cpu_count() or 1, lambda share: progress.tell(_so_far(share, setting.duration_s), share)
        )
    except KeyboardInterrupt:
        return stopped()
    end_status_line()
    unwritten = _unwritten(record, orders.plan, reports)
    for line in _lacking(reports):
        talk(line)
    told = summary(setting, reports)
    (print_json if as_json else _show)(told)
    if unwritten:  # what robots did is told all the same
        raise unwritten
    return 0 if told["completed"] == told["robots"] else 1


def _warn_of_few(setting: MissionRun) -> None:
    """Warn of a team in which P2 does not hold once f_max robots are compromised."""
    least = BtiConfig(f_max=setting.f_max).least_robots
    if setting.audited and setting.robots < least:
        talk(
            f"if {setting.f_max} of {setting.robots} robots lie, they may have others stopped: P2 takes {least} robots"
            f" with f_max {setting.f_max}"
        )


def _warn_of_wheels(setting: MissionRun) -> None:
    """Says so where odometry may be worse than robots allow for."""
    (way, turn), config = setting.noise.always, setting.config
    if way > config.odometry_way or turn > config.odometry_turn:
        talk(
            f"wheels may be wrong by {100 * way:g} % of the way and {100 * turn:g} % of turns; robots allow for"
            f" {100 * config.odometry_way:g} and {100 * config.odometry_turn:g}: their fixes may be false"
        )


def _unwritten(record: Path | None, plan: FloorPlan, reports: list[Report]) -> Unavailable | None:
    """What keeps a recording that was asked for from being written."""
    if record is not None:
        try:
            write_recording(record, plan, reports)
        except Unavailable as error:
            return error
        click.echo(f"recorded: {record}", err=True)
    return None


def _fleet(named: str, robots: int | None, parts: int) -> tuple[tuple[int, ...], int]:
    """(ids, if they are said; how many robots: one for each part, if nobody says otherwise)."""
    ids = parse_robots(named) if named else ()
    count = robots if robots is not None else len(ids) or parts
    if ids and len(ids) != count:
        raise UsageError(f"--as names {counted(len(ids), 'robot')} of {count}", "an id for each, in their order")
    return ids, count


def _begun(plan: FloorPlan, *, told: bool) -> FloorPlan:
    """The floor plan; with a place where robots begin, if nobody has told it."""
    if told or plan.start is not None:
        return plan
    start = x_m, y_m, yaw_rad = most_spacious_start(plan)
    degrees = math.degrees(yaw_rad)
    talk(f"{plan.name} does not say where robots begin: where there is most room, --start {x_m:g},{y_m:g},{degrees:g}")
    return replace(plan, start=start)


def _so_far(share: float, duration_s: float) -> str:
    return "simulated to the end" if share >= 1 else f"{100 * share:.0f} % of at most {duration_s:g} s simulated"


def _admit(encoded: EncodedMission, ids: tuple[int, ...], robots: int, now_s: float) -> None:
    """Refuse what a robot would: a mission for others than `ids` (without, than it names), or for another time."""
    meant = encoded.header.robots
    if not ids and meant and robots > len(meant):
        raise UsageError(f"{robots} robots", f"the mission is for {len(meant)}")
    for robot in ids or meant[:1] or (1,):
        admit(encoded, robot, now_s, ())


def _encoded(plain: Mission, profile: str, seed: int) -> list[File]:
    # From the seed: a simulation's secrets keep nobody out, and the same seed shall give the same digest.
    draws = random.Random(seed).randbytes  # noqa: S311
    options = BuildOptions(profile=Profile[profile.upper()])
    return [(each.mission, each.key) for each in build(plain, options, draws)]


def parse_start(said: str) -> Pose:
    """X,Y[,DEGREES] as a pose. Raises: UsageError: it is not written so."""
    try:
        x, y, degrees = (float(word) for word in (*said.split(","), "90")[:3])
    except ValueError as error:
        raise UsageError(f"{said!r} is no start", "X,Y in metres, or X,Y,DEGREES") from error
    if said.count(",") > 2 or not all(abs(value) < 1e5 for value in (x, y, degrees)):
        raise UsageError(f"{said!r} is no start", "X,Y in metres, or X,Y,DEGREES")
    return x, y, math.radians(degrees)


def _lacking(reports: list[Report]) -> list[str]:
    """What a mission's author would have told the world, as far as robots can tell by what stopped them."""
    lines = [
        f"robot {report.robot + 1} does not stand where its mission begins: --world NAME for another building, --start"
        " X,Y, or --furnish MISSION.yaml and files in the order of its parts"
        for report in reports
        if not report.decoded
    ]
    if lacks := sorted({what for report in reports for what in report.lacks}):
        lines.append(f"not in this world: {', '.join(lacks)}; --furnish MISSION.yaml brings codes, beacons and actions")
    return lines


def _show(told: dict[str, Any]) -> None:
    click.echo(
        f"{told['completed']} of {counted(told['robots'], 'robot')} completed   "
        f"{told['decoded']} of {told['nodes']} nodes decoded   "
        f"{told['false_fixes']} false fixes   {told['false_decodes']} false decodes   {told['t_s']:.0f} s"
    )
    if told["defence"] != "none":
        audits = told["audits"]
        click.echo(f"defence               {told['defence']}, f_max {told['f_max']}")
        click.echo(f"audits                {audits['passed']} passed, {audits['refused']} refused")
        stopped = f"robots {', '.join(map(str, told['in_safe_mode']))}" if told["in_safe_mode"] else "none"
        click.echo(f"in Safe Mode          {stopped}")
    click.echo(f"hashes tried          {told['hashes_tried']}")
    for name, words, unit in (
        ("search_ms", "search", "ms"),
        ("extraction_ms", "extraction", "ms"),
        ("pose_error_m", "pose error", "m"),
        ("odometry_error_m", "odometry alone", "m"),
    ):
        cells = [
            f"{which} {value:.3f} {unit}"
            for which in ("p50", "max")
            if (value := told.get(f"{name}_{which}")) is not None  # nothing was searched, or seen
        ]
        click.echo(f"{words:22}{'   '.join(cells) or '-'}")
    for row in told["drift"]:
        learnt = format_drift((row["way"], row["turn"], row["curve_radpm"]))
        click.echo(f"robot {row['robot']:<4} its wheels err by   {learnt}")
    for row in told["actions"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   did {row['action']}")
    for row in told["not_validated"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   did not find the next landmark: {row['reason']}")
    click.echo(f"digest {told['digest']}")
