"""Encode missions, print them, check them and draw them, for their author."""

from __future__ import annotations

import hashlib
import itertools
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from phalanx.cli.credentials import read_signing_key, read_trusted
from phalanx.cli.terminal import Progress, counted, end_status_line, print_json, status_line, talk
from phalanx.config.builtin import built_in
from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.lab.figures.missions import check_drawable, draw_mission
from phalanx.mission import BuildOptions, Built, EncodedMission, Mission, Profile, admit, build, check_signature, sign
from phalanx.mission.authoring.survey import most_spacious_start, survey, with_start
from phalanx.mission.file.records import FINAL, FOREVER_S, JOIN, OPEN_START, REPEATABLE, ROAM, START
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.sites import is_shown, landmarks_of
from phalanx.mission.observable import Landmark
from phalanx.mission.worth.audit import audit
from phalanx.mission.worth.feasible import look_ahead
from phalanx.mission.worth.outlook import Outlook
from phalanx.net.private_file import write_private
from phalanx.world.building.floorplan import load_floorplan

from .draw import lived
from .files import building, check_folder, doors_of, parse_robots, parse_window, read_encoded, read_plain
from .run import parse_start

WARNINGS = 10  # told by build
TELL_LOCKS = 16  # from one word of progress to the next
# What a header that is silent about these says.
UNLIMITED = {"robots": "anybody", "valid_to_s": "for ever", "signer": "nobody", "flags": "none"}
FLAGS = ((REPEATABLE, "repeatable"), (ROAM, "roam"), (OPEN_START, "open start"))
NODE_FLAGS = ((START, "start"), (FINAL, "final"), (JOIN, "join"))


def build_files(
    source: str | None,
    out: Path,
    profile: str,
    plan: str | None,
    start: str | None,
    doors: str | None,
    lidar: str,
    sign_key: Path | None,
    robots: str,
    valid: str,
    open_start: bool,
    offset_mm: int,
    seed: int | None,
    as_json: bool,
) -> None:
    """Writes the encoded mission, a file for each of its parts, and their start keys beside them."""
    check_folder(out)
    begin, end = parse_window(valid)
    options = BuildOptions(
        profile=Profile[profile.upper()],
        robots=parse_robots(robots) if robots else (),
        valid_from_s=begin,
        valid_to_s=end,
        open_start=open_start,
        offset_mm=offset_mm,
    )
    key = read_signing_key(sign_key) if sign_key else None
    eye = LidarConfig.parse(lidar)
    if source is None:
        told, floor = explored(plan, start, "build", doors, eye)
        _warn(told, options.profile, look_ahead(told, None, floor, eye), f"--map {plan} ", floor.extraction)
    else:
        told = checked(source, plan, start, doors)
        _warn(told, options.profile, None, "MISSION.yaml ", _doors(plan or told.floor_plan, doors))
    if seed is not None:
        click.echo("phalanx: warning: built from a seed: whoever knows it reads the mission", err=True)
    rows = []
    for one in _build(told, options, os.urandom if seed is None else _seeded(seed)):
        path = out.with_stem(f"{out.stem}-{one.part}") if one.part else out
        signed = one.mission if key is None else sign(one.mission, key)
        data = signed.encode()
        try:
            path.write_bytes(data)
        except OSError as error:
            raise Unavailable(f"cannot write {path}: {error.strerror}", "choose another --out") from error
        row: dict[str, Any] = {"file": str(path), "bytes": len(data), **_summary(signed)}
        if (one.key.gates and not open_start) or one.key.messages:
            secret = path.with_name(path.name + ".key")
            write_private(secret, one.key.encode(), replace=True)
            row["key"] = str(secret)
        rows.append(row)
    if as_json:
        print_json({"mission": told.name, "files": rows})
        return
    for row in rows:
        signer = f"signed by {row['signer'][:16]}…" if row["signer"] else "not signed"
        click.echo(f"{row['file']}   {row['nodes']} nodes   {row['bytes']} bytes   {row['profile']}   {signer}")
        if "key" in row:
            click.echo(f"{row['key']}   start key: send it over the link, keep it from everybody else")


def explored(
    name: str | None, start: str | None, what: str, doors: str | None = None, lidar: LidarConfig | None = None
) -> tuple[Mission, FloorPlan]:
    """Return the mission to find all landmarks of a map, and the map with a start. Raises: UsageError: no map."""
    if name is None:
        raise UsageError(f"nothing to {what}", f"a YAML file, one of {', '.join(built_in('missions'))}, or --map MAP")
    plan, begin = building(name, doors, swept=True), None if start is None else parse_start(start)
    if begin is None and plan.start is None:
        begin = most_spacious_start(building(name, doors))  # where no dust lies either: it may be something
        where = f"in its roomiest place, for run: --start {begin[0]},{begin[1]}"
        talk(f"{plan.name} does not say where robots begin: {where}")
    plan = plan if begin is None else with_start(plan, begin)
    if plan.dust:
        talk(f"{plan.name}: {counted(plan.dust, 'lone cell')} left out as dust, each of which robots get around")
    status_line(f"looking for landmarks and ways: {len(plan.walls)} walls")
    try:
        return survey(plan, lidar=lidar), plan
    finally:
        end_status_line()


def checked(source: str, plan: str | None, start: str | None, doors: str | None = None) -> Mission:
    """A plain mission; warns of landmarks that a floor plan does not show. Raises: UsageError: it cannot be read."""
    if start is not None:
        raise UsageError("--start is for missions made from a map", "the mission's start node says where it begins")
    floor = building(plan, doors) if plan else None
    told = read_plain(source)
    if floor is not None:
        sites = landmarks_of(floor)
        for node in told.nodes:
            for alias in node.see:
                for thing in alias:
                    if isinstance(thing, Landmark) and not is_shown(thing, sites):
                        click.echo(f"phalanx: warning: {node.name}: the map shows no such {thing.type}", err=True)
    return told


def _doors(plan: str | None, doors: str | None) -> ExtractionConfig | None:
    """Which doors robots see, as --door-width says, or else the map, if it is there."""
    if doors is not None:
        return doors_of(doors)
    try:
        return load_floorplan(plan).extraction if plan else None
    except UsageError:
        return None  # whoever needs the map says so


def _warn(told: Mission, profile: Profile, outlook: Outlook | None, of: str, doors: ExtractionConfig | None) -> None:
    report = audit(told, profile, outlook=outlook, doors=doors)
    looks = [f"{row.name}: {problem}" for row in report.nodes for problem in row.problems]
    if report.feasible is False:
        dark = [f"{row.name} {row.infeasible[0]}" for row in report.nodes if row.infeasible]
        looks = [f"no robot can be expected to live it to its end: {len(dark)} nodes, first {dark[0]}", *looks]
    for line in looks[:WARNINGS]:
        click.echo(f"phalanx: warning: {line}", err=True)
    if len(looks) > WARNINGS:
        more = f"{len(looks) - WARNINGS} more; phalanx mission audit {of}--profile {profile.name.lower()} tells them"
        click.echo(f"phalanx: warning: {more}", err=True)


def _seeded(seed: int) -> Callable[[int], bytes]:
    count = itertools.count(1)
    return lambda size: hashlib.shake_256(f"phalanx mission {seed} {next(count)}".encode()).digest(size)


def _build(told: Mission, options: BuildOptions, random: Callable[[int], bytes]) -> list[Built]:
    locks = sum(len(node.see) for node in told.nodes)
    done = 0
    progress = Progress()
    with ThreadPoolExecutor(os.cpu_count()) as pool:

        def spread(work: Callable[[Any], Any], jobs: Iterable[Any]) -> Iterator[Any]:
            nonlocal done
            for answer in pool.map(work, jobs):
                done += 1
                if not done % TELL_LOCKS:
                    progress.tell(f"{done} of {locks} locks", done / locks)
                yield answer

        try:
            return build(told, options, random, spread)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            if done >= TELL_LOCKS:
                end_status_line()


def _summary(encoded: EncodedMission) -> dict[str, Any]:
    header = encoded.header
    return {
        "id": header.mission_id.hex(),
        "profile": header.profile.name.lower(),
        "nodes": header.nodes,
        "ways": sum(len(node.ways) for node in encoded.nodes),
        "robots": list(header.robots),
        "valid_from_s": header.valid_from_s,
        "valid_to_s": None if header.valid_to_s == FOREVER_S else header.valid_to_s,
        "flags": [word for bit, word in FLAGS if header.flags & bit],
        "signer": encoded.signer.hex(),
    }


def inspect(file: Path, as_json: bool) -> None:
    """Prints what anybody can read in an encoded mission."""
    encoded = read_encoded(file)
    nodes: list[dict[str, Any]] = [
        {
            "node": i,
            "flags": [word for bit, word in NODE_FLAGS if record.flags & bit],
            "aliases": len(record.aliases),
            "hash": record.aliases[0].mark.hex(),
            "to": [way.target for way in record.ways],
        }
        for i, record in enumerate(encoded.nodes)
    ]
    if as_json:
        coding = asdict(encoded.header.coding)
        print_json({**_summary(encoded), "coding": coding, "nodes": nodes})
        return
    for name, value in _summary(encoded).items():
        words = ", ".join(map(str, value)) if isinstance(value, list) else value
        click.echo(f"{name:14}{words or UNLIMITED.get(name, value)}")
    for node in nodes:
        ways = " ".join(map(str, node["to"]))
        click.echo(f"{node['node']:6}  {node['hash'][:16]}…  {' '.join(node['flags']):12}  -> {ways}")


def verify(file: Path, trust: tuple[str, ...], robot: int | None, now_s: float | None, as_json: bool) -> int:
    """Checks that a mission is whole and signed, and prints by whom. Raises: PeerError: it is not."""
    trusted = [read_trusted(key) for key in trust] or None
    try:
        encoded = read_encoded(file)
        check_signature(encoded, trusted)
        if robot is not None or now_s is not None:
            now = time.time() if now_s is None else now_s
            for_anybody = replace(encoded, header=replace(encoded.header, robots=()))
            admit(encoded if robot is not None else for_anybody, robot or 0, now, ())
    except PeerError as error:
        if as_json:
            print_json({"ok": False, "reason": error.reason, "message": str(error)})
        raise
    if as_json:
        print_json({"ok": True, "trusted": trusted is not None, **_summary(encoded)})
    else:
        whom = "trusted" if trusted else "whole; signed by"
        click.echo(f"{file}   {whom} {encoded.signer.hex()}")
    return 0


def draw(source: str | None, out: Path, plan: str | None, start: str | None, simulate: bool, seed: int) -> None:
    """Writes a picture of a mission; also of a run of it, if `simulate`."""
    check_drawable(out)
    told = explored(plan, start, "draw")[0] if source is None else checked(source, None, start)
    name = plan or told.floor_plan
    floor = load_floorplan(name) if name else None
    if simulate and floor is None:
        raise UsageError("no map to simulate a robot on", "--map MAP, or map: NAME in the mission")
    reports = lived(told, floor, seed) if simulate and floor is not None else []
    draw_mission(told, floor, out, reports)
    for report in reports:
        end = "completed it" if report.done else f"stopped: {report.not_validated[-1][1]}"
        click.echo(f"robot {report.robot + 1}: {len(report.decoded)} nodes, {report.t_s:.0f} s, {end}", err=True)
    click.echo(f"drawn: {out}", err=True)
