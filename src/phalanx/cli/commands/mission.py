"""`phalanx mission`: encode missions, look at them, live them, and find out what they are worth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from phalanx.cli import options
from phalanx.cli.complete import a_map, a_mission, a_mission_or_encoded, an_encoded_mission
from phalanx.cli.options import FILE, option, out_option, runs

OWN_MAP = "Your own building: phalanx docs guides/maps."
PROFILES = click.Choice(["paper", "sealed"])
profile_option = option(
    "--profile",
    help="sealed needs a start key; paper can be read by trying all places.",
    type=PROFILES,
    default="sealed",
)
start_option = option(
    "--start",
    help="Where robots begin, for a mission made from --map. Default: what the map says, or a spacious place.",
    metavar="X,Y[,DEGREES]",
)
door_option = option(
    "--door-width",
    "doors",
    help="Narrowest and widest doorway, metres. Default: what the map says, or 1.2,2.5 as in the paper.",
    metavar="LEAST,MOST",
)
lidar_option = option(
    "--lidar",
    help="The robots' lidar: field of view, beams, and range and noise in metres.",
    metavar="DEGREES[,BEAMS[,RANGE[,NOISE]]]",
    default="270,1080,30,0.01",
)
offset_option = option(
    "--offset-mm",
    help="Round landmarks' offsets to this: the file tells less, and robots know places less exactly.",
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
    """Encode, check and run missions that a robot can only read step by step, at the right places."""


@mission.command(epilog="Example: phalanx mission build office --out office.phxm --sign-key operator.pem")
@source_argument
@out_option("The encoded mission.")
@profile_option
@map_option("Floor plan: make a mission that explores it, or check the mission against it.")
@start_option
@door_option
@lidar_option
@option("--sign-key", help="Sign the mission with this Ed25519 key, PEM.", type=FILE)
@option("--robots", help="Robots that may run it: 1,2,7 or 1-5. Default: all.", metavar="IDS", default="")
@option(
    "--valid",
    help="When it may run: seconds or dates; either may be empty.",
    metavar="FROM/TO",
    default="/",
    show_default=False,
)
@option("--open-start", help="Put the start key into the file: anybody can start it.", is_flag=True)
@offset_option
@option("--seed", help="Make the same bytes again. For tests only: the secrets can be guessed.", type=int)
@options.json_option
@runs("mission.author", "build_files")
def build() -> None:
    """Encode a mission; write its start key to OUT.key.

    Without a mission, --map MAP makes one: to find every landmark of the map. A mission in parts gives a file for each.
    """


@mission.command(epilog="Example: phalanx mission inspect office.phxm --json")
@file_argument
@options.json_option
@runs("mission.author", "inspect")
def inspect() -> None:
    """Show what anybody can read in an encoded mission: header, nodes, and how they are connected."""


@mission.command(epilog="Example: phalanx mission verify office.phxm --trust operator.pub --robot 7")
@file_argument
@option("--trust", help="Public key: 64 hex digits or a PEM file; repeatable.", multiple=True, metavar="KEY")
@option("--robot", help="Check also that this robot may run it.", type=click.IntRange(0, 65_535))
@option("--at", "now_s", help="Check for this time, in seconds on the mission's clock. Default: now.", type=float)
@options.json_option
@runs("mission.author", "verify")
def verify() -> None:
    """Check that a mission is complete and signed. If not, print the reason and exit with 1.

    Without --trust any signature is accepted: it proves that nothing was altered, not who wrote it.
    """


@mission.command(epilog="Example: phalanx mission audit office --profile paper")
@source_argument
@profile_option
@map_option("Floor plan: check the mission against it, or audit the mission that build would make of it.")
@start_option
@door_option
@lidar_option
@option("--open-start", help="Assume that the attacker has the start key too.", is_flag=True)
@offset_option
@option(
    "--trial", help="Run it this many times in its map, with as many seeds, and report.", type=click.IntRange(1, 1000)
)
@options.json_option
@runs("mission.worth", "tell_worth")
def audit() -> None:
    """Report how hard a captured mission is to read, and where robots would fail to follow it.

    The numbers of tries and the times are upper bounds, without a floor plan and with it. Somebody with the plan can
    find places without opening anything: phalanx docs explanation/threats-missions. A path fails if it
    is too long for its time-out, if no landmark is in sight, or if a robot cannot tell a landmark from the next alike.
    """


@mission.command(epilog="Example: phalanx mission draw office --out office.svg --run")
@source_argument
@out_option("A .png or .svg file.")
@map_option("Floor plan to draw behind it; without, the one the mission names. Alone: draw what build makes of it.")
@start_option
@option("--run", "simulate", help="Simulate a robot on the map (one for each part): draw its path.", is_flag=True)
@option("--seed", help="Seed of --run.", type=click.IntRange(0), default=0)
@runs("mission.author", "draw")
def draw() -> None:
    """Draw a mission's landmarks and paths on its map.

    With --run, also draw a robot's path, its own estimate of it, and the path by odometry alone.
    """


@mission.command(epilog="Example: phalanx mission crack office.phxm --box 0,0,40,40 --budget 60")
@file_argument
@option("--key", help="The start key, if the attacker has it (sealed profile).", type=FILE)
@option("--box", help="Area to search, metres.", metavar="X0,Y0,X1,Y1", default="0,0,40,40")
@map_option("The building's floor plan: what it shows is tried first (sealed profile).")
@offset_option
@option("--budget", help="Stop after this many seconds.", type=click.FloatRange(min=0.1), default=30.0)
@options.json_option
@runs("mission.crack", "crack")
def crack() -> None:
    """Try to read a captured mission by brute force until the budget is used up. Exit with 1 if nothing was found."""


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
@option("--robots", help="Number of robots. Default: one for each part of the mission.", type=int)
@option("--as", "named", help="Their ids: 1,2,7 or 1-5. Default: those that a FILE is for.", metavar="IDS", default="")
@option(
    "--noise",
    help="Errors of the odometry, for distance and turns: drawn once (stage), as given (fixed), or drawn each step.",
    default="0.03,0.05",
    metavar="SIGMA_T,SIGMA_R[,stage|fixed|step]",
)
@option("--profile", help="Profile to encode a plain mission in, before it runs.", type=PROFILES, default="sealed")
@option("--key", help="Start key of one sealed FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these signed; repeatable.", multiple=True, metavar="KEY")
@option("--at", "at_s", help="The mission's clock at the start, s. Default: when it becomes valid.", type=float)
@option(
    "--start",
    "said_start",
    help="Where robots begin. Default: where the mission or the map says.",
    metavar="X,Y[,DEGREES]",
)
@options.defence_option(
    default="none",
    show_default=True,
    help="How robots audit each other; for up to 32 robots, without --meet.",
)
@option(
    "--f-max",
    help="How many compromised robots audits tolerate. Takes f_max + 2 robots; with fewer than 2 f_max + 3,"
    " compromised ones may have others stopped.",
    type=click.IntRange(1, 15),
    default=1,
)
@option("--people", help="People who walk about in the building.", default=0)
@option(
    "--strangers",
    help="Tell robots to expect this many objects that look like landmarks and are on no map.",
    type=click.FloatRange(0, 1000),
    default=0.0,
    show_default=False,
    metavar="PER_M2",
)
@option("--duration", "duration_s", help="Stop after this many simulated seconds.", default=1800.0)
@option(
    "--meet",
    "meet_m",
    help="Robots within this distance, metres, exchange where they were.",
    default=0.0,
    show_default=False,
)
@option("--seed", help="Seed of all random numbers.", default=0)
@options.record_option
@options.json_option
@runs("mission.run", "run")
def run() -> None:
    """Run a mission in a simulated building. Exit with 1 if a robot did not complete it.

    A plain mission is encoded first, from the seed. The same mission, options and seed give the same digest. Of encoded
    files each robot gets one, in turn, and --furnish says what is in the building.
    """


@mission.command(
    epilog="Example: phalanx mission ros2 office.phxm --start 2,3,90 --namespace r1 -- --ros-args -p"
    " laser_in_base:='[-0.03, 0.0, 0.0]'"
)
@file_argument
@click.argument("ros", nargs=-1, metavar="[-- ROS2 ARGUMENTS]")
@option("--start", "said_start", help="Where base_link is, in the map.", metavar="X,Y[,DEGREES]", required=True)
@option("--robot", help="Id of this robot.", type=click.IntRange(1, 65_535), default=1)
@door_option
@option("--namespace", default="", metavar="NAME", help="Namespace of the robot's topics and node.")
@option("--key", help="Start key of a sealed FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these signed; repeatable.", multiple=True, metavar="KEY")
@options.json_option
@runs("mission.ros2", "ros2")
def ros2() -> None:
    """Run an encoded mission on a ROS 2 robot: scan and odom in, cmd_vel out. Exit with 1 if not completed.

    The file, its start key and where the robot stands are all that it knows: no map. It needs ROS 2:
    pip install '.[ros2]' in a clone.
    """
