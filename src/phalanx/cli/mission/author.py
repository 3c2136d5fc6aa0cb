"""Encode, inspect, verify and draw missions."""

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
from phalanx.cli.terminal import Progress, count_of, end_status_line, print_json, status_line, talk
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

from .draw import simulate_parts
from .files import building, check_folder, doors_of, parse_robots, parse_window, read_encoded, read_plain
from .run import parse_start

WARNINGS = 10  # printed by build
TELL_LOCKS = 16  # from one progress report to the next
# Values of header fields that are unset.
UNLIMITED = {"robots": "any", "valid_to_s": "unlimited", "signer": "none", "flags": "none"}
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
    """Write the encoded mission, one file per part, and the start keys beside the files."""
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
    scanner = LidarConfig.parse(lidar)
    if source is None:
        mission, floor = explored(plan, start, "build", doors, scanner)
        _warn(mission, options.profile, look_ahead(mission, None, floor, scanner), f"--map {plan} ", floor.extraction)
    else:
        mission = checked(source, plan, start, doors)
        _warn(mission, options.profile, None, "MISSION.yaml ", _doors(plan or mission.floor_plan, doors))
    if seed is not None:
        click.echo("phalanx: warning: built from a seed: anybody who knows the seed can read the mission", err=True)
    rows = []
    for one in _build(mission, options, os.urandom if seed is None else _seeded(seed)):
        path = out.with_stem(f"{out.stem}-{one.part}") if one.part else out
        signed = one.mission if key is None else sign(one.mission, key)
        data = signed.encode()
        try:
            path.write_bytes(data)
        except OSError as error:
            raise Unavailable(f"cannot write {path}: {error.strerror}", "use another --out") from error
        row: dict[str, Any] = {"file": str(path), "bytes": len(data), **_summary(signed)}
        if (one.key.gates and not open_start) or one.key.messages:
            secret = path.with_name(path.name + ".key")
            write_private(secret, one.key.encode(), replace=True)
            row["key"] = str(secret)
        rows.append(row)
    if as_json:
        print_json({"mission": mission.name, "files": rows})
        return
    for row in rows:
        signer = f"signed by {row['signer'][:16]}…" if row["signer"] else "not signed"
        click.echo(f"{row['file']}   {row['nodes']} nodes   {row['bytes']} bytes   {row['profile']}   {signer}")
        if "key" in row:
            click.echo(f"{row['key']}   start key: send it to the robots, and keep it secret")


def explored(
    name: str | None, start: str | None, what: str, doors: str | None = None, lidar: LidarConfig | None = None
) -> tuple[Mission, FloorPlan]:
    """Return a mission that finds all landmarks of a map, and the map with a start. Raises: UsageError: no map."""
    if name is None:
        known = ", ".join(built_in("missions"))
        raise UsageError(f"nothing to {what}", f"give a YAML file, one of {known}, or --map MAP")
    plan, begin = building(name, doors, swept=True), None if start is None else parse_start(start)
    if begin is None and plan.start is None:
        begin = most_spacious_start(building(name, doors))  # on the map with dust: it may be an obstacle
        where = f"using its most open space, --start {begin[0]},{begin[1]} of run"
        talk(f"{plan.name} has no start: {where}")
    plan = plan if begin is None else with_start(plan, begin)
    if plan.dust:
        talk(f"{plan.name}: {count_of(plan.dust, 'lone cell')} ignored as dust: robots avoid single cells")
    status_line(f"searching landmarks and paths: {len(plan.walls)} walls")
    try:
        return survey(plan, lidar=lidar), plan
    finally:
        end_status_line()


def checked(source: str, plan: str | None, start: str | None, doors: str | None = None) -> Mission:
    """Return a plain mission; warn of landmarks that the floor plan lacks. Raises: UsageError: it cannot be read."""
    if start is not None:
        raise UsageError("--start is for missions made from a map", "leave it out: the mission's start node has it")
    floor = building(plan, doors) if plan else None
    mission = read_plain(source)
    if floor is not None:
        sites = landmarks_of(floor)
        for node in mission.nodes:
            for alias in node.see:
                for thing in alias:
                    if isinstance(thing, Landmark) and not is_shown(thing, sites):
                        click.echo(f"phalanx: warning: {node.name}: no such {thing.type} on the map", err=True)
    return mission


def _doors(plan: str | None, doors: str | None) -> ExtractionConfig | None:
    """Return the door widths of --door-width, or else of the map if it exists."""
    if doors is not None:
        return doors_of(doors)
    try:
        return load_floorplan(plan).extraction if plan else None
    except UsageError:
        return None  # reported where the map is needed


def _warn(mission: Mission, profile: Profile, outlook: Outlook | None, of: str, doors: ExtractionConfig | None) -> None:
    report = audit(mission, profile, outlook=outlook, doors=doors)
    problems = [f"{row.name}: {problem}" for row in report.nodes for problem in row.problems]
    if report.feasible is False:
        infeasible = [f"{row.name} {row.infeasible[0]}" for row in report.nodes if row.infeasible]
        count = len(infeasible)
        problems = [f"no robot is expected to complete it: {count} infeasible nodes, first {infeasible[0]}", *problems]
    for line in problems[:WARNINGS]:
        click.echo(f"phalanx: warning: {line}", err=True)
    if len(problems) > WARNINGS:
        more = f"{len(problems) - WARNINGS} more; phalanx mission audit {of}--profile {profile.name.lower()} lists them"
        click.echo(f"phalanx: warning: {more}", err=True)


def _seeded(seed: int) -> Callable[[int], bytes]:
    count = itertools.count(1)
    return lambda size: hashlib.shake_256(f"phalanx mission {seed} {next(count)}".encode()).digest(size)


def _build(mission: Mission, options: BuildOptions, random: Callable[[int], bytes]) -> list[Built]:
    locks = sum(len(node.see) for node in mission.nodes)
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
            return build(mission, options, random, spread)
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
    """Print the unencrypted content of an encoded mission."""
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
    """Check that a mission is complete and signed, and print its signer. Raises: PeerError: it is not."""
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
        verdict = "complete; signed by trusted" if trusted else "complete; signed by"
        click.echo(f"{file}   {verdict} {encoded.signer.hex()}")
    return 0


def draw(source: str | None, out: Path, plan: str | None, start: str | None, simulate: bool, seed: int) -> None:
    """Draw a mission, and with `simulate` also a run of it."""
    check_drawable(out)
    mission = explored(plan, start, "draw")[0] if source is None else checked(source, None, start)
    name = plan or mission.floor_plan
    floor = load_floorplan(name) if name else None
    if simulate and floor is None:
        raise UsageError("no map to simulate a robot on", "use --map MAP, or map: NAME in the mission")
    reports = simulate_parts(mission, floor, seed) if simulate and floor is not None else []
    draw_mission(mission, floor, out, reports)
    for report in reports:
        end = "completed it" if report.done else f"stopped: {report.not_validated[-1][1]}"
        click.echo(f"robot {report.robot + 1}: {len(report.decoded)} nodes, {report.t_s:.0f} s, {end}", err=True)
    click.echo(f"drawn: {out}", err=True)
