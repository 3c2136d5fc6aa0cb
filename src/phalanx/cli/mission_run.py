"""`phalanx mission run`: robots that know only the encoded graph live a mission in a simulated building."""

from __future__ import annotations

import math
import os
import random
from pathlib import Path
from typing import Any

import click

from phalanx.errors import UsageError
from phalanx.mission import (
    BuildOptions,
    Built,
    EncodedMission,
    Mission,
    Profile,
    admit,
    build,
    check_signature,
)
from phalanx.mission.survey import roomiest
from phalanx.mission.walker import LONGEST_S
from phalanx.sim.floorplan import DEFAULT, load_floorplan
from phalanx.sim.mission_orders import furnished
from phalanx.sim.mission_recording import write_recording
from phalanx.sim.mission_run import MissionRun, Part, pool_of, run_mission, summary
from phalanx.sim.odometry import OdometryNoise, Pose

from .mission_files import is_encoded, read_encoded, read_plain, read_trusted, start_key_of
from .terminal import Progress, counted, end_status_line, print_json, talk


@click.command(
    "run", epilog="Example: phalanx mission run office --world office_40x40 --robots 4 --noise 0.03,0.05,stage"
)
@click.argument("source", metavar="FILE|BUILTIN")
@click.option("--world", "world", metavar="NAME|FILE", help="The building; without, the one the mission names.")
@click.option("--robots", type=int, help="How many; without, one for each part of the mission.")
@click.option(
    "--noise",
    default="0.03,0.05",
    show_default=True,
    metavar="SIGMA_T,SIGMA_R[,stage|fixed|step]",
    help="Of the odometry: for way and turns, and where the factor comes from.",
)
@click.option(
    "--profile",
    type=click.Choice([profile.name.lower() for profile in Profile]),
    default="sealed",
    show_default=True,
    help="In which a plain mission is encoded first.",
)
@click.option("--key", type=click.Path(path_type=Path), help="Start key of a sealed FILE; without, FILE.key.")
@click.option("--trust", multiple=True, metavar="KEY", help="Refuse a FILE that none of these signed; repeatable.")
@click.option("--at", "at_s", type=float, help="The mission's clock at the start, s; without, when it becomes valid.")
@click.option(
    "--start",
    "said_start",
    metavar="X,Y[,DEGREES]",
    help="Where robots are put; without, where the mission or the map says.",
)
@click.option("--duration", type=float, default=1800.0, show_default=True, help="Simulated seconds at most.")
@click.option(
    "--meet", "meet_m", type=float, default=0.0, help="Robots so near, metres, tell each other where they were."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of everything that is drawn.")
@click.option(
    "--record", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.mcap", help="Record it for Foxglove."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def run_command(
    source: str,
    world: str | None,
    robots: int | None,
    noise: str,
    profile: str,
    key: Path | None,
    trust: tuple[str, ...],
    at_s: float | None,
    said_start: str | None,
    duration: float,
    meet_m: float,
    seed: int,
    record: Path | None,
    as_json: bool,
) -> int:
    """Run a mission; exit 1 if a robot did not complete it.

    A plain mission is encoded first, from the seed. The same mission, options and seed give the same digest.
    """
    trusted = [read_trusted(word) for word in trust] or None
    plain: Mission | None = None
    if is_encoded(source):
        encoded = read_encoded(Path(source))
        pairs = [(encoded, start_key_of(Path(source), key, encoded, "--key"))]
    else:
        if trusted or key:
            raise UsageError("--trust and --key are for encoded missions", "phalanx mission build makes one")
        plain = read_plain(source)
        pairs = [(each.mission, each.key) for each in _built(plain, profile, seed)]
    plan = load_floorplan(world or (plain.floor_plan if plain and plain.floor_plan else DEFAULT))
    told_start = parse_start(said_start) if said_start else plan.start
    if told_start is None:
        told_start = roomiest(plan)
        talk(f"{plan.name} does not say where robots begin: where there is most room, --start {_words(told_start)}")
    if plain is not None:
        plan = furnished(plan, plain)
    count = robots if robots is not None else len(pairs)
    begin_s = float(pairs[0][0].header.valid_from_s) if at_s is None else at_s
    if not 0 <= begin_s < LONGEST_S:
        raise UsageError(f"--at {begin_s:g}", "seconds since 1970")
    if plain is None:
        _admit(pairs[0][0], trusted, count, begin_s)
    run = MissionRun(
        plan=plan,
        parts=tuple(
            Part(encoded, start_key, told_start if said_start else _start(told_start, plain, part))
            for part, (encoded, start_key) in enumerate(pairs)
        ),
        robots=count,
        noise=OdometryNoise.parse(noise),
        seed=seed,
        begin_s=begin_s,
        duration_s=duration,
        pool=pool_of(plain) if plain else (),
        controller=tuple(message for _, start_key in pairs if start_key for message in start_key.messages.values()),
        meet_m=meet_m,
        keep_trace=record is not None,
    )
    progress = Progress()
    try:
        reports = run_mission(
            run, os.cpu_count() or 1, lambda share: progress.tell(_so_far(share, run.duration_s), share)
        )
    except KeyboardInterrupt:
        end_status_line()
        click.echo("stopped", err=True)
        return 1
    end_status_line()
    if record is not None:
        write_recording(record, plan, reports)
        click.echo(f"recorded: {record}", err=True)
    told = summary(run, reports)
    if as_json:
        print_json(told)
    else:
        _show(told)
    return 0 if told["completed"] == told["robots"] else 1


def _words(pose: Pose) -> str:
    return f"{pose[0]:g},{pose[1]:g},{math.degrees(pose[2]):g}"


def _so_far(share: float, duration_s: float) -> str:
    return "simulated to the end" if share >= 1 else f"{share * duration_s:.0f} of at most {duration_s:g} s simulated"


def _admit(encoded: EncodedMission, trusted: list[bytes] | None, robots: int, now_s: float) -> None:
    """Refuse what a robot would: a mission that nobody trusted signed, for others, or for another time."""
    if trusted or encoded.signer:
        check_signature(encoded, trusted)
    if encoded.header.robots and robots > len(encoded.header.robots):
        raise UsageError(f"{robots} robots", f"the mission is for {len(encoded.header.robots)}")
    admit(encoded, (encoded.header.robots or (1,))[0], now_s, ())


def _built(plain: Mission, profile: str, seed: int) -> list[Built]:
    # From the seed: a simulation's secrets keep nobody out, and the same seed shall give the same digest.
    return build(plain, BuildOptions(profile=Profile[profile.upper()]), random.Random(seed).randbytes)  # noqa: S311


def parse_start(said: str) -> Pose:
    """X,Y[,DEGREES] as a pose.

    Raises: UsageError: it is not written so.
    """
    try:
        x, y, degrees = (float(word) for word in (*said.split(","), "90")[:3])
    except ValueError as error:
        raise UsageError(f"{said!r} is no start", "X,Y in metres, or X,Y,DEGREES") from error
    if said.count(",") > 2 or not all(abs(value) < 1e5 for value in (x, y, degrees)):
        raise UsageError(f"{said!r} is no start", "X,Y in metres, or X,Y,DEGREES")
    return x, y, math.radians(degrees)


def _start(otherwise: Pose, plain: Mission | None, part: int) -> Pose:
    """Where a part's robots are put: its start node's place, if the author is asked; else where the map says."""
    if plain is None:
        return otherwise
    name = plain.parts[part]
    place = next(node.place for node in plain.nodes if node.start and node.part == name)
    return otherwise if place is None else (*place, otherwise[2])


def _show(told: dict[str, Any]) -> None:
    click.echo(
        f"{told['completed']} of {counted(told['robots'], 'robot')} completed   "
        f"{told['decoded']} of {told['nodes']} nodes decoded   "
        f"{told['false_fixes']} false fixes   {told['t_s']:.0f} s"
    )
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
    for row in told["actions"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   did {row['action']}")
    for row in told["not_validated"]:
        click.echo(f"robot {row['robot']:<4} {row['t_s']:>7.1f} s   not validated: {row['reason']}")
    click.echo(f"digest {told['digest']}")
