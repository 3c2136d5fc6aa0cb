"""`phalanx mission`: encode missions, inspect and run them, and measure how well they resist attackers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from phalanx.cli import options
from phalanx.cli.complete import a_map, a_mission, a_mission_or_encoded, an_encoded_mission
from phalanx.cli.options import FILE, implemented_by, option, out_option

OWN_MAP = "Your own building: phalanx docs guides/maps."
PROFILES = click.Choice(["paper", "sealed"])
profile_option = option(
    "--profile",
    help="sealed: a start key is needed to read the mission. paper: it can be read by trying all places.",
    type=PROFILES,
    default="sealed",
)
start_option = option(
    "--start",
    help="Start pose, for a mission made from --map. Default: the one in the map, or an open space.",
    metavar="X,Y[,DEGREES]",
)
door_option = option(
    "--door-width",
    "doors",
    help="Narrowest and widest doorway, metres. Default: those in the map, or 1.2,2.5 as in the paper.",
    metavar="LEAST,MOST",
)
lidar_option = option(
    "--lidar",
    help="The robots' lidar: field of view in degrees, number of beams, range and noise in metres.",
    metavar="DEGREES[,BEAMS[,RANGE[,NOISE]]]",
    default="270,1080,30,0.01",
)
offset_option = option(
    "--offset-mm",
    help="Round landmark offsets to this: the file reveals less, and robots localise less exactly.",
    type=click.IntRange(1, 50),
    default=1,
)
source_argument = click.argument("source", required=False, shell_complete=a_mission, metavar="[MISSION.yaml|BUILTIN]")
file_argument = click.argument("file", type=FILE, shell_complete=an_encoded_mission)


def map_option(words: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option --map with help that begins with the text `words`."""
    return option("--map", "plan", help=f"{words} {OWN_MAP}", metavar="MAP", shell_complete=a_map)


@click.group(epilog="Example: phalanx mission build office --out office.phxm")
def mission() -> None:
    """Encode, check and run missions that a robot can only read step by step, at the right places."""


@mission.command(epilog="Example: phalanx mission build office --out office.phxm --sign-key operator.pem")
@source_argument
@out_option("File for the encoded mission.")
@profile_option
@map_option("Floor plan: make a mission that explores it, or check the mission against it.")
@start_option
@door_option
@lidar_option
@option("--sign-key", help="Sign the mission with the Ed25519 key in this PEM file.", type=FILE)
@option("--robots", help="Ids of the robots that may run it, as 1,2,7 or 1-5. Default: all.", metavar="IDS", default="")
@option(
    "--valid",
    help="Period of validity: seconds or dates; either may be empty.",
    metavar="FROM/TO",
    default="/",
    show_default=False,
)
@option("--open-start", help="Put the start key into the file: anybody can start the mission.", is_flag=True)
@offset_option
@option("--seed", help="Seed for reproducible output. For tests only: the secrets can be guessed.", type=int)
@options.json_option
@implemented_by("mission.author", "build_files")
def build() -> None:
    """Encode a mission and write its start key to OUT.key.

    Without a mission, --map MAP makes one that visits every landmark of the map. A mission in parts is written as one
    file for each part.
    """


@mission.command(epilog="Example: phalanx mission inspect office.phxm --json")
@file_argument
@options.json_option
@implemented_by("mission.author", "inspect")
def inspect() -> None:
    """Show the unencrypted content of an encoded mission: header, nodes, and how they are connected."""


@mission.command(epilog="Example: phalanx mission verify office.phxm --trust operator.pub --robot 7")
@file_argument
@option(
    "--trust", help="Accept this signer's key: 64 hex digits or a PEM file; repeatable.", multiple=True, metavar="KEY"
)
@option("--robot", help="Also check that this robot may run it.", type=click.IntRange(0, 65_535))
@option("--at", "now_s", help="Time to check for, in seconds on the mission's clock. Default: now.", type=float)
@options.json_option
@implemented_by("mission.author", "verify")
def verify() -> None:
    """Check that a mission is complete and signed. If not, print the reason and exit with 1.

    Without --trust any signature is accepted. It proves that nothing was altered, but not who wrote the mission.
    """


@mission.command(epilog="Example: phalanx mission audit office --profile paper")
@source_argument
@profile_option
@map_option("Floor plan: check the mission against it, or audit the mission that build would make from it.")
@start_option
@door_option
@lidar_option
@option("--open-start", help="Assume that the attacker also has the start key.", is_flag=True)
@offset_option
@option(
    "--trial", help="Also simulate the mission this many times, each with another seed.", type=click.IntRange(1, 1000)
)
@options.json_option
@implemented_by("mission.worth", "print_audit")
def audit() -> None:
    """Report how hard a captured mission is to read, and where robots would fail to follow it.

    The numbers of tries and the times are upper bounds, without and with a floor plan. An attacker with the plan can
    find places without decrypting a node: phalanx docs explanation/threats-missions. A path fails if it is too long
    for its time-out, if no landmark is in sight, or if a robot cannot distinguish a landmark from a similar one.
    """


@mission.command(epilog="Example: phalanx mission draw office --out office.svg --run")
@source_argument
@out_option("File for the drawing, .png or .svg.")
@map_option("Floor plan behind the mission. Default: the mission's. Without a mission: draw the one that build makes.")
@start_option
@option("--run", "simulate", help="Simulate a robot for each part on the map, and draw its path.", is_flag=True)
@option("--seed", help="Seed of --run.", type=click.IntRange(0), default=0)
@implemented_by("mission.author", "draw")
def draw() -> None:
    """Draw a mission's landmarks and paths on its map.

    With --run, also draw the robot's path, its own estimate of the path, and the path by odometry alone.
    """


@mission.command(epilog="Example: phalanx mission crack office.phxm --box 0,0,40,40 --budget 60")
@file_argument
@option("--key", help="The start key, if the attacker has it (sealed profile).", type=FILE)
@option("--box", help="Area to search, metres.", metavar="X0,Y0,X1,Y1", default="0,0,40,40")
@map_option("The building's floor plan: its places are tried first (sealed profile).")
@offset_option
@option("--budget", help="Stop after this many seconds.", type=click.FloatRange(min=0.1), default=30.0)
@options.json_option
@implemented_by("mission.crack", "crack")
def crack() -> None:
    """Try to read a captured mission by brute force until the budget is used up. Exit with 1 if nothing was found."""


@mission.command(
    epilog="Examples: phalanx mission run office --world office_40x40 --robots 4 --noise 0.03,0.05,stage; "
    "phalanx mission run two-a.phxm two-b.phxm --furnish inspection"
)
@click.argument("sources", nargs=-1, required=True, shell_complete=a_mission_or_encoded, metavar="FILE...|BUILTIN")
@option(
    "--world",
    help=f"The building. Default: the one that the mission names, or office_40x40. {OWN_MAP}",
    metavar="NAME|FILE",
    shell_complete=a_map,
)
@door_option
@lidar_option
@options.furnish_option
@option("--robots", help="Number of robots. Default: one for each part of the mission.", type=int)
@option("--as", "named", help="Ids of the robots, as 1,2,7 or 1-5. Default: those in FILE.", metavar="IDS", default="")
@option(
    "--noise",
    help="Odometry errors for distance and turns: drawn once (stage), constant (fixed), or drawn at each step (step).",
    default="0.03,0.05",
    metavar="SIGMA_T,SIGMA_R[,stage|fixed|step]",
)
@option("--profile", help="Profile in which a plain mission is encoded.", type=PROFILES, default="sealed")
@option("--key", help="Start key of one sealed FILE. Default: FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these keys signed; repeatable.", multiple=True, metavar="KEY")
@option("--at", "at_s", help="The mission's clock at the start, seconds. Default: start of its validity.", type=float)
@option(
    "--start",
    "start_text",
    help="Start pose. Default: the one in the mission or the map.",
    metavar="X,Y[,DEGREES]",
)
@options.defence_option(
    default="none",
    show_default=True,
    help="How robots audit each other; for up to 32 robots, without --meet.",
)
@option(
    "--f-max",
    help="Number of compromised robots that audits tolerate. Needs f_max + 2 robots; with fewer than 2 f_max + 3,"
    " compromised robots can cause others to be stopped.",
    type=click.IntRange(1, 15),
    default=1,
)
@option("--people", help="Number of people who walk about in the building.", default=0)
@option(
    "--strangers",
    help="Density of objects that look like landmarks and are on no map, as robots are to assume it.",
    type=click.FloatRange(0, 1000),
    default=0.0,
    show_default=False,
    metavar="PER_M2",
)
@option("--duration", "duration_s", help="Stop after this many simulated seconds.", default=1800.0)
@option(
    "--meet",
    "meet_m",
    help="Robots within this distance, metres, exchange the places they visited.",
    default=0.0,
    show_default=False,
)
@option("--seed", help="Seed of all random numbers.", default=0)
@options.record_option
@options.json_option
@implemented_by("mission.run", "run")
def run() -> None:
    """Run a mission in a simulated building. Exit with 1 if a robot did not complete it.

    A plain mission is first encoded, from the seed. The same mission, options and seed give the same digest. Encoded
    files are assigned to the robots in turn; --furnish then sets the objects in the building.
    """


@mission.command(
    epilog="Example: phalanx mission ros2 office.phxm --start 2,3,90 --namespace r1 -- --ros-args -p"
    " laser_in_base:='[-0.03, 0.0, 0.0]'"
)
@file_argument
@click.argument("ros", nargs=-1, metavar="[-- ROS2 ARGUMENTS]")
@option("--start", "start_text", help="Pose of base_link in the map.", metavar="X,Y[,DEGREES]", required=True)
@option("--robot", help="Id of this robot.", type=click.IntRange(1, 65_535), default=1)
@door_option
@option("--namespace", default="", metavar="NAME", help="Namespace of the robot's topics and node.")
@option("--key", help="Start key of a sealed FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a FILE that none of these keys signed; repeatable.", multiple=True, metavar="KEY")
@options.json_option
@implemented_by("mission.ros2", "ros2")
def ros2() -> None:
    """Run an encoded mission on a ROS 2 robot: scan and odom in, cmd_vel out. Exit with 1 if not completed.

    The robot needs no map: only the file, its start key and its start pose. Requires ROS 2: pip install '.[ros2]' in a
    clone.
    """
