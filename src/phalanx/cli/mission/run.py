"""`phalanx mission run`: run an encoded mission in a simulated building."""

from __future__ import annotations

import math
import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from phalanx.cli.terminal import Progress, count_of, end_status_line, print_json, stopped, talk
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
    start_text: str | None,
    strangers: float,
    record: Path | None,
    as_json: bool,
    **how: Any,
) -> int:
    """Run a mission and print the outcome. Return 1 if a robot did not complete it."""
    if record is not None:
        check_folder(record)
    able = {
        "noise": OdometryNoise.parse(noise),
        "lidar": LidarConfig.parse(lidar),
        "config": MissionConfig(strangers_per_m2=strangers),
    }
    files, plain = Wanted(sources, furnish, key, trust, "--key").read()
    ids, count = _fleet(named, robots, len(files or (plain.parts if plain else ())))
    if how["defence"] != "none":  # before the mission is encoded
        check_count(count, how["f_max"])
    start = parse_start(start_text) if start_text else None
    name = world or (plain.floor_plan if plain else "")
    plan = _with_start(building(name or DEFAULT, doors), is_given=start is not None)
    if not name:
        talk(f"in {DEFAULT}; use --world for another building")
    if plain is not None and not files:
        files = _encoded(plain, profile, how["seed"])
    orders = orders_of_files(Path(sources[0]).stem, files, plan, plain, start)
    begin_s = float(max(encoded.header.valid_from_s for encoded, _ in files)) if at_s is None else at_s
    if not 0 <= begin_s < LONGEST_S:
        raise UsageError(f"--at {begin_s:g}", "use seconds since 1970")
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
    for line in _missing_in_world(reports):
        talk(line)
    told = summary(setting, reports)
    (print_json if as_json else _show)(told)
    if unwritten:  # after the outcome is printed
        raise unwritten
    return 0 if told["completed"] == told["robots"] else 1


def _warn_of_few(setting: MissionRun) -> None:
    """Warn if promise P2 does not hold for this team once f_max robots are compromised."""
    least = BtiConfig(f_max=setting.f_max).least_robots
    if setting.audited and setting.robots < least:
        talk(
            f"{setting.f_max} compromised of {setting.robots} robots can cause others to be stopped: promise P2 needs"
            f" {least} robots with f_max {setting.f_max}"
        )


def _warn_of_wheels(setting: MissionRun) -> None:
    """Warn if odometry errors can exceed the limits that robots assume."""
    (distance, turn), config = setting.noise.always, setting.config
    if distance > config.odometry_way or turn > config.odometry_turn:
        talk(
            f"odometry errors up to {100 * distance:g} % of the distance and {100 * turn:g} % of turns; robots assume"
            f" at most {100 * config.odometry_way:g} and {100 * config.odometry_turn:g}: their fixes can be false"
        )


def _unwritten(record: Path | None, plan: FloorPlan, reports: list[Report]) -> Unavailable | None:
    """Write the recording, if requested, and return the error if that failed."""
    if record is not None:
        try:
            write_recording(record, plan, reports)
        except Unavailable as error:
            return error
        click.echo(f"recorded: {record}", err=True)
    return None


def _fleet(named: str, robots: int | None, parts: int) -> tuple[tuple[int, ...], int]:
    """Return the ids, if given, and the number of robots: by default one for each part."""
    ids = parse_robots(named) if named else ()
    count = robots if robots is not None else len(ids) or parts
    if ids and len(ids) != count:
        raise UsageError(f"--as names {count_of(len(ids), 'robot')} of {count}", "give an id for each robot, in order")
    return ids, count


def _with_start(plan: FloorPlan, *, is_given: bool) -> FloorPlan:
    """Return the floor plan, with a start if neither the plan nor an option has one."""
    if is_given or plan.start is not None:
        return plan
    start = x_m, y_m, yaw_rad = most_spacious_start(plan)
    degrees = math.degrees(yaw_rad)
    talk(f"{plan.name} has no start: using its most open space, --start {x_m:g},{y_m:g},{degrees:g}")
    return replace(plan, start=start)


def _so_far(share: float, duration_s: float) -> str:
    return "simulated to the end" if share >= 1 else f"{100 * share:.0f} % of at most {duration_s:g} s simulated"


def _admit(encoded: EncodedMission, ids: tuple[int, ...], robots: int, now_s: float) -> None:
    """Refuse a mission as its robots would: if it is for others than `ids`, for fewer robots, or for another time."""
    permitted = encoded.header.robots
    if not ids and permitted and robots > len(permitted):
        raise UsageError(f"{robots} robots for a mission of {len(permitted)}", f"use --robots {len(permitted)}")
    for robot in ids or permitted[:1] or (1,):
        admit(encoded, robot, now_s, ())


def _encoded(plain: Mission, profile: str, seed: int) -> list[File]:
    # From the seed: the secrets of a simulation protect nothing, and the same seed must give the same digest.
    draws = random.Random(seed).randbytes  # noqa: S311
    options = BuildOptions(profile=Profile[profile.upper()])
    return [(each.mission, each.key) for each in build(plain, options, draws)]


def parse_start(text: str) -> Pose:
    """Return the pose in X,Y[,DEGREES]. Raises: UsageError."""
    try:
        x, y, degrees = (float(word) for word in (*text.split(","), "90")[:3])
    except ValueError as error:
        raise UsageError(f"invalid start {text!r}", "use X,Y in metres, or X,Y,DEGREES") from error
    if text.count(",") > 2 or not all(abs(value) < 1e5 for value in (x, y, degrees)):
        raise UsageError(f"invalid start {text!r}", "use X,Y in metres, or X,Y,DEGREES")
    return x, y, math.radians(degrees)


def _missing_in_world(reports: list[Report]) -> list[str]:
    """Return hints on what the building lacks, as far as the robots' failures show it."""
    lines = [
        f"robot {report.robot + 1} is not at the start of its mission: use --world NAME for another building, --start"
        " X,Y, or --furnish MISSION.yaml and files in the order of its parts"
        for report in reports
        if not report.decoded
    ]
    if lacks := sorted({what for report in reports for what in report.lacks}):
        lines.append(f"not in this world: {', '.join(lacks)}; --furnish MISSION.yaml adds codes, beacons and actions")
    return lines


def _show(told: dict[str, Any]) -> None:
    click.echo(
        f"{told['completed']} of {count_of(told['robots'], 'robot')} completed   "
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
            if (value := told.get(f"{name}_{which}")) is not None  # no search, or no landmark
        ]
        click.echo(f"{words:22}{'   '.join(cells) or '-'}")
    for row in told["drift"]:
        drift = format_drift((row["way"], row["turn"], row["curve_radpm"]))
        click.echo(f"robot {row['robot']:<4} odometry error    {drift}")
    for row in told["actions"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   did {row['action']}")
    for row in told["not_validated"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   did not find the next landmark: {row['reason']}")
    click.echo(f"digest {told['digest']}")
