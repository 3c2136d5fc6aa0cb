"""`phalanx mission`: encode missions, look at them, live them, and find out what they are worth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from phalanx.cli.complete import a_map, a_mission, a_mission_or_encoded, an_encoded_mission
from phalanx.cli.options import defence_option, furnish_option, json_option, record_option

from .runs import runs

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
OWN_MAP = "One of your own: docs/maps.md."
PROFILES = click.Choice(["paper", "sealed"])
profile_option = click.option(
    "--profile", type=PROFILES, default="sealed", show_default=True, help="paper hides nothing from who tries all."
)
start_option = click.option(
    "--start",
    metavar="X,Y[,DEGREES]",
    help="Where robots begin, as for run; with --map alone. Without, where the map says, or its roomiest place.",
)
source_argument = click.argument("source", required=False, shell_complete=a_mission, metavar="[MISSION.yaml|BUILTIN]")
file_argument = click.argument("file", type=click.Path(path_type=Path), shell_complete=an_encoded_mission)


def map_option(words: str) -> Decorator:
    """--map, in words of the command's own."""
    return click.option("--map", "plan", metavar="MAP", shell_complete=a_map, help=f"{words} {OWN_MAP}")


def out_option(words: str) -> Decorator:
    """--out, a file that is made."""
    return click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help=words)


@click.group(epilog="Example: phalanx mission build office --out office.phxm")
def mission() -> None:
    """What may be done: missions that a robot can only read by living them."""


@mission.command(epilog="Example: phalanx mission build office --out office.phxm --sign-key operator.pem")
@source_argument
@out_option("The encoded mission.")
@profile_option
@map_option("Floor plan: explore it, or check the mission against it.")
@start_option
@click.option("--sign-key", type=click.Path(path_type=Path), help="Ed25519 key of the operator, PEM.")
@click.option("--robots", metavar="IDS", default="", help="Who may run it: 1,2,7 or 1-5; anybody without.")
@click.option("--valid", metavar="FROM/TO", default="/", help="When: seconds or dates; either may be empty.")
@click.option("--open-start", is_flag=True, help="Put the start key into the file: anybody may begin.")
@click.option("--seed", type=int, help="Same bytes again; the secrets can be guessed, so never in earnest.")
@json_option
@runs("mission.author", "build_files")
def build() -> None:
    """Encode a mission; its start key goes into OUT.key.

    Without a mission, --map MAP makes one: to find every landmark of the map. A mission in parts gives a file for each.
    """


@mission.command(epilog="Example: phalanx mission inspect office.phxm --json")
@file_argument
@json_option
@runs("mission.author", "inspect")
def inspect() -> None:
    """Show what anybody can read in an encoded mission: header, nodes, and which way leads where."""


@mission.command(epilog="Example: phalanx mission verify office.phxm --trust operator.pub --robot 7")
@file_argument
@click.option("--trust", multiple=True, metavar="KEY", help="Public key: 64 hex digits or a PEM file; repeatable.")
@click.option("--robot", type=click.IntRange(0, 65_535), help="Whether this robot may run it.")
@click.option("--at", "now_s", type=float, help="When, in seconds on the mission's clock; now without.")
@json_option
@runs("mission.author", "verify")
def verify() -> None:
    """Check that a mission is whole and signed; exit 1 and the reason if not.

    Without --trust any signature will do: it proves that nothing was altered since, not who wrote it.
    """


@mission.command(epilog="Example: phalanx mission audit office --profile paper")
@source_argument
@profile_option
@map_option("The mission that build makes of this map, or what to check against.")
@start_option
@click.option("--open-start", is_flag=True, help="Suppose that the start key was captured too.")
@json_option
@runs("mission.author", "tell_worth")
def audit() -> None:
    """Tell what a captured file is worth: what an attacker must try, what the robot must, and what looks wrong."""


@mission.command(epilog="Example: phalanx mission draw office --out office.svg --run")
@source_argument
@out_option("A .png or .svg file.")
@map_option("Floor plan to draw behind it; without, the one the mission names. Alone: draw what build makes of it.")
@start_option
@click.option("--run", "simulate", is_flag=True, help="Simulate a robot on the map (one for each part): draw its path.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of --run.")
@runs("mission.author", "draw")
def draw() -> None:
    """Draw a mission's landmarks and ways on its map.

    With --run also where a robot went, where it believed to be, and where odometry alone would have put it.
    """


@mission.command(epilog="Example: phalanx mission crack office.phxm --box 0,0,40,40 --budget 60")
@file_argument
@click.option("--key", type=click.Path(path_type=Path), help="The start key, captured too (sealed profile).")
@click.option("--box", metavar="X0,Y0,X1,Y1", default="0,0,40,40", show_default=True, help="Where to look, metres.")
@click.option("--budget", type=click.FloatRange(min=0.1), default=30.0, show_default=True, help="Seconds to go on.")
@json_option
@runs("mission.crack", "crack")
def crack() -> None:
    """Try to read a captured mission by brute force: for real, as long as the budget lasts. Exit 1 if nothing gave."""


@mission.command(
    epilog="Examples: phalanx mission run office --world office_40x40 --robots 4 --noise 0.03,0.05,stage; "
    "phalanx mission run two-a.phxm two-b.phxm --furnish inspection"
)
@click.argument("sources", nargs=-1, required=True, shell_complete=a_mission_or_encoded, metavar="FILE...|BUILTIN")
@click.option(
    "--world",
    metavar="NAME|FILE",
    shell_complete=a_map,
    help=f"The building; without, the one the mission names, or office_40x40. {OWN_MAP}",
)
@furnish_option
@click.option("--robots", type=int, help="How many; without, one for each part of the mission.")
@click.option(
    "--noise",
    default="0.03,0.05",
    show_default=True,
    metavar="SIGMA_T,SIGMA_R[,stage|fixed|step]",
    help="Of the odometry: for way and turns, and where the factor comes from.",
)
@click.option(
    "--profile", type=PROFILES, default="sealed", show_default=True, help="In which a plain mission is encoded first."
)
@click.option("--key", type=click.Path(path_type=Path), help="Start key of one sealed FILE; without, FILE.key.")
@click.option("--trust", multiple=True, metavar="KEY", help="Refuse a FILE that none of these signed; repeatable.")
@click.option("--at", "at_s", type=float, help="The mission's clock at the start, s; without, when it becomes valid.")
@click.option(
    "--start",
    "said_start",
    metavar="X,Y[,DEGREES]",
    help="Where robots are put; without, where the mission or the map says.",
)
@defence_option(
    default="none",
    show_default=True,
    help="Whether robots audit each other: up to 32, without codes, sensors and --meet.",
)
@click.option(
    "--f-max",
    type=click.IntRange(1, 15),
    default=1,
    show_default=True,
    help="Liars that audits tolerate; of at least f_max + 2 robots: each finds f_max + 1 others to vouch for it.",
)
@click.option("--people", type=int, default=0, show_default=True, help="Who walk about in the building.")
@click.option("--duration", type=float, default=1800.0, show_default=True, help="Simulated seconds at most.")
@click.option(
    "--meet", "meet_m", type=float, default=0.0, help="Robots so near, metres, tell each other where they were."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of everything that is drawn.")
@record_option
@json_option
@runs("mission.run", "run")
def run() -> None:
    """Run a mission; exit 1 if a robot did not complete it.

    A plain mission is encoded first, from the seed. The same mission, options and seed give the same digest. Of encoded
    files each robot gets one, in turn. A file says neither which codes hang on the walls nor what robots can do nor
    where they begin: --furnish does.
    """
