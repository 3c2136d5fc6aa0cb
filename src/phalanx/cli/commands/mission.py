"""`phalanx mission`: encode missions, look at them, live them, and find out what they are worth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from phalanx.cli import options
from phalanx.cli.complete import a_map, a_mission, a_mission_or_encoded, an_encoded_mission
from phalanx.cli.options import FILE, option, out_option, runs

OWN_MAP = "One of your own: docs/guides/maps.md."
PROFILES = click.Choice(["paper", "sealed"])
profile_option = option("--profile", help="paper hides nothing from who tries all.", type=PROFILES, default="sealed")
start_option = option(
    "--start",
    help="Where robots begin, as for run; with --map alone. Without, where the map says, or its roomiest place.",
    metavar="X,Y[,DEGREES]",
)
door_option = option(
    "--door-width",
    "doors",
    help="Metres between jambs of what counts as a doorway; without, as the map says, or 1.2,2.5 as in the paper.",
    metavar="LEAST,MOST",
)
lidar_option = option(
    "--lidar",
    help="What robots see with: field of view, beams, and metres of range and noise.",
    metavar="DEGREES[,BEAMS[,RANGE[,NOISE]]]",
    default="270,1080,30,0.01",
)
offset_option = option(
    "--offset-mm",
    help="Round offsets of cells to so much: they tell less, and robots know places less exactly.",
    type=click.IntRange(1, 50),
    default=1,
)
source_argument = click.argument("source", required=False, shell_complete=a_mission, metavar="[MISSION.yaml|BUILTIN]")
file_argument = click.argument("file", type=FILE, shell_complete=an_encoded_mission)


def map_option(words: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--map, in words of the command's own."""
    return option("--map", "plan", help=f"{words} {OWN_MAP}", metavar="MAP", shell_complete=a_map)


@click.group(epilog="Example: phalanx mission build office --out office.phxm")
def mission() -> None:
    """What may be done: missions that a robot can only read by living them."""


@mission.command(epilog="Example: phalanx mission build office --out office.phxm --sign-key operator.pem")
@source_argument
@out_option("The encoded mission.")
@profile_option
@map_option("Floor plan: explore it, or check the mission against it.")
@start_option
@door_option
@lidar_option
@option("--sign-key", help="Ed25519 key of the operator, PEM.", type=FILE)
@option("--robots", help="Who may run it: 1,2,7 or 1-5; anybody without.", metavar="IDS", default="")
@option(
    "--valid", help="When: seconds or dates; either may be empty.", metavar="FROM/TO", default="/", show_default=False
)
@option("--open-start", help="Put the start key into the file: anybody may begin.", is_flag=True)
@offset_option
@option("--seed", help="Same bytes again; the secrets can be guessed, so never in earnest.", type=int)
@options.json_option
@runs("mission.author", "build_files")
def build() -> None:
    """Encode a mission; its start key goes into OUT.key.

    Without a mission, --map MAP makes one: to find every landmark of the map. A mission in parts gives a file for each.
    """


@mission.command(epilog="Example: phalanx mission inspect office.phxm --json")
@file_argument
@options.json_option
@runs("mission.author", "inspect")
def inspect() -> None:
    """Show what anybody can read in an encoded mission: header, nodes, and which way leads where."""


@mission.command(epilog="Example: phalanx mission verify office.phxm --trust operator.pub --robot 7")
@file_argument
@option("--trust", help="Public key: 64 hex digits or a PEM file; repeatable.", multiple=True, metavar="KEY")
@option("--robot", help="Whether this robot may run it.", type=click.IntRange(0, 65_535))
@option("--at", "now_s", help="When, in seconds on the mission's clock; now without.", type=float)
@options.json_option
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
@door_option
@lidar_option
@option("--open-start", help="Suppose that the start key was captured too.", is_flag=True)
@offset_option
@option("--trial", help="Live it so often in its map, from as many seeds, and report.", type=click.IntRange(1, 1000))
@options.json_option
@runs("mission.worth", "tell_worth")
def audit() -> None:
    """Tell what a mission is worth: what who captures it must try, what looks wrong, and what no robot can live.

    Candidates and times to open nodes are upper bounds, without a floor plan and with it. Who has the plan finds places
    without opening anything: docs/explanation/threats-missions.md. A robot's belief is
    run ahead along each way: too long for its time-out, nothing in sight, or too unsure to tell a landmark from the
    next that looks the same.
    """


@mission.command(epilog="Example: phalanx mission draw office --out office.svg --run")
@source_argument
@out_option("A .png or .svg file.")
@map_option("Floor plan to draw behind it; without, the one the mission names. Alone: draw what build makes of it.")
@start_option
@option("--run", "simulate", help="Simulate a robot on the map (one for each part): draw its path.", is_flag=True)
@option("--seed", help="Of --run.", type=click.IntRange(0), default=0)
@runs("mission.author", "draw")
def draw() -> None:
    """Draw a mission's landmarks and ways on its map.

    With --run also where a robot went, where it believed to be, and where odometry alone would have put it.
    """


@mission.command(epilog="Example: phalanx mission crack office.phxm --box 0,0,40,40 --budget 60")
@file_argument
@option("--key", help="The start key, captured too (sealed profile).", type=FILE)
@option("--box", help="Where to look, metres.", metavar="X0,Y0,X1,Y1", default="0,0,40,40")
@map_option("The building's floor plan: what it shows is tried first (sealed profile).")
@offset_option
@option("--budget", help="Seconds to go on.", type=click.FloatRange(min=0.1), default=30.0)
@options.json_option
@runs("mission.crack", "crack")
def crack() -> None:
    """Try to read a captured mission by brute force: for real, as long as the budget lasts. Exit 1 if nothing gave."""


@mission.command(
    epilog="Examples: phalanx mission run office --world office_40x40 --robots 4 --noise 0.03,0.05,stage; "
    "phalanx mission run two-a.phxm two-b.phxm --furnish inspection"
)
@click.argument("sources", nargs=-1, required=True, shell_complete=a_mission_or_encoded, metavar="FILE...|BUILTIN")
@option(
    "--world",
    help=f"The building; without, the one the mission names, or office_40x40. {OWN_MAP}",
    metavar="NAME|FILE",
    shell_complete=a_map,
)
@door_option
@lidar_option
@options.furnish_option
@option("--robots", help="How many; without, one for each part of the mission.", type=int)
@option(
    "--as", "named", help="Which they are: 1,2,7 or 1-5; without, those that a FILE is for.", metavar="IDS", default=""
)
@option(
    "--noise",
    help="Of the odometry: for way and turns, and where the factor comes from.",
    default="0.03,0.05",
    metavar="SIGMA_T,SIGMA_R[,stage|fixed|step]",
)
@option("--profile", help="In which a plain mission is encoded first.", type=PROFILES, default="sealed")
@option("--key", help="Start key of one sealed FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these signed; repeatable.", multiple=True, metavar="KEY")
@option("--at", "at_s", help="The mission's clock at the start, s; without, when it becomes valid.", type=float)
@option(
    "--start",
    "said_start",
    help="Where robots are put; without, where the mission or the map says.",
    metavar="X,Y[,DEGREES]",
)
@options.defence_option(
    default="none",
    show_default=True,
    help="Whether robots audit each other: up to 32, without --meet.",
)
@option(
    "--f-max",
    help="The most compromised robots that audits tolerate; of at least f_max + 2 robots, to get f_max + 1 tokens each,"
    " and of 2 f_max + 3, or f_max of them may have others stopped.",
    type=click.IntRange(1, 15),
    default=1,
)
@option("--people", help="Who walk about in the building.", default=0)
@option(
    "--strangers",
    help="Robots are told that so many things of a look stand there that no map shows: one match is not enough.",
    type=click.FloatRange(0, 1000),
    default=0.0,
    show_default=False,
    metavar="PER_M2",
)
@option("--duration", "duration_s", help="Simulated seconds at most.", default=1800.0)
@option(
    "--meet", "meet_m", help="Robots so near, metres, tell each other where they were.", default=0.0, show_default=False
)
@option("--seed", help="Of everything that is drawn.", default=0)
@options.record_option
@options.json_option
@runs("mission.run", "run")
def run() -> None:
    """Run a mission; exit 1 if a robot did not complete it.

    A plain mission is encoded first, from the seed. The same mission, options and seed give the same digest. Of encoded
    files each robot gets one, in turn. A file says neither which codes hang on the walls nor what robots can do nor
    where they begin: --furnish does.
    """


@mission.command(
    epilog="Example: phalanx mission ros2 office.phxm --start 2,3,90 --namespace r1 -- --ros-args -p"
    " laser_in_base:='[-0.03, 0.0, 0.0]'"
)
@file_argument
@click.argument("ros", nargs=-1, metavar="[-- ROS2 ARGUMENTS]")
@option("--start", "said_start", help="Where base_link stands, in the map.", metavar="X,Y[,DEGREES]", required=True)
@option("--robot", help="Which one this is.", type=click.IntRange(1, 65_535), default=1)
@door_option
@option("--namespace", default="", metavar="NAME", help="Of the robot's topics and node.")
@option("--key", help="Start key of a sealed FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these signed; repeatable.", multiple=True, metavar="KEY")
@options.json_option
@runs("mission.ros2", "ros2")
def ros2() -> None:
    """Live an encoded mission with a robot of ROS 2: scan and odom in, cmd_vel out; exit 1 if it was not completed.

    The file, its start key and where the robot stands are all that it knows: no map. It needs ROS 2:
    pip install '.[ros2]' in a clone.
    """
