"""`phalanx robot`: run one robot as a process, or several in a simulated field."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.complete import a_scenario, an_attack_by_robots
from phalanx.cli.options import FILE, OUT_FOLDER, implemented_by, option, out_option

robot_argument = click.argument("robot", type=FILE, metavar="ROBOT.yaml")
SHARE = click.FloatRange(0, 0.9)


@click.group(epilog="Example: phalanx robot arena --robots 4 --attack hijack:robot=3,at=5")
def robot() -> None:
    """Run one real robot as a process, or several in a simulated field."""


@robot.command(epilog="Example: phalanx robot run robot-3.yaml; phalanx docs guides/robot says what the file may hold")
@robot_argument
@implemented_by("robot", "run")
def run() -> None:
    """Run the robot in ROBOT.yaml until SIGINT or SIGTERM. Each run needs a new mission key."""


@robot.command(epilog="Example: phalanx robot ros2 robot-1.yaml --namespace r1 -- --ros-args -p ahead_m:=0.3")
@robot_argument
@click.argument("ros", nargs=-1, metavar="[-- ROS2 ARGUMENTS]")
@option("--namespace", default="", metavar="NAME", help="Namespace of the robot's topics and node.")
@implemented_by("robot", "ros2")
def ros2() -> None:
    """Run the robot in ROBOT.yaml as a guard between cmd_vel_raw and cmd_vel of ROS 2.

    Requires ROS 2: pip install '.[ros2]' in a clone.
    """


@robot.command(epilog="Example: phalanx robot advise mission.yaml planner.py:Home unix:advice")
@click.argument("mission", type=FILE)
@click.argument("planner", metavar="PLANNER.py:CLASS")
@click.argument("where", metavar="unix:PATH|udp:ADDRESS:PORT")
@option(
    "--sign",
    type=FILE,
    metavar="ADVICE.pem",
    help="Sign advice with this key; the mission contains its public key as adviser_key.",
)
@option("--key", "issued", type=FILE, metavar="MISSION.json", help="File of phalanx keys issue; with --sign.")
@option(
    "--robot",
    "robots_at",
    multiple=True,
    metavar="N=ADDRESS",
    help="Accept robot N from this UDP address only; repeatable.",
)
@implemented_by("robot", "advise")
def advise() -> None:
    """Run a planner as a process, for robots whose ROBOT.yaml has its address under planner."""


@robot.command(epilog="Example: phalanx robot provision robot-3.yaml lab.keys; phalanx keys create makes the latter")
@robot_argument
@click.argument("keys", type=FILE)
@options.passphrase_option
@implemented_by("robot", "provision")
def provision() -> None:
    """Load the master key from the file KEYS into the trusted nodes that ROBOT.yaml names. Works once."""


@robot.command(epilog="Example: phalanx robot arena --robots 8 --attack hijack:robot=3,at=10 --loss 0.2 --json")
@click.argument("scenario", default="flock-12", shell_complete=a_scenario)
@option("--robots", type=int, metavar="N", help="Number of robots: each is a process, plus one for its trusted nodes.")
@option("--duration", "duration_s", type=float, metavar="S", help="Seconds of real time.")
@option("--f-max", type=int, metavar="F", help="Number of compromised robots that the mission tolerates.")
@option("--seed", type=int, metavar="S", help="Seed of all random numbers.")
@option(
    "--attack",
    "attacks",
    help="Attack by one robot: a name of phalanx attack list, or your own FILE.py:CLASS; repeatable.",
    multiple=True,
    shell_complete=an_attack_by_robots,
    metavar="NAME|FILE.py:CLASS[:robot=I,at=T,…]",
)
@option("--sealed", is_flag=True, help="Seal all radio packets (phalanx docs spec/sealed-radio).")
@option(
    "--on-air",
    multiple=True,
    metavar="NAME[:robot=I,at=T]",
    help="Attack by a radio that bypasses the a-node: past, replay, hold or foreign-key; repeatable.",
)
@option("--loss", type=SHARE, help="Share of packets lost; unicast packets are retransmitted. Default: SCENARIO's.")
@option("--repeats", type=SHARE, default=0.0, help="Share of packets duplicated.")
@option("--delay-ms", type=click.FloatRange(0, 10_000), default=5.0, help="Maximum delay of a packet.")
@option(
    "--speed", type=click.FloatRange(0.05, 1), default=1.0, help="Speed as a share of real time, for busy machines."
)
@option(
    "--cut",
    type=int,
    default=0,
    metavar="N",
    help="Partition the radio network: the first N robots and the others do not receive each other.",
)
@option("--cut-at", "cut_at_s", type=float, default=10.0, metavar="S", help="Time of the partition, seconds.")
@option("--clock-ppm", type=int, default=0, metavar="PPM", help="Maximum clock drift of each robot, fast or slow.")
@options.controller_option
@option(
    "--planner",
    metavar="FILE.py:CLASS|unix:PATH|udp:ADDRESS:PORT",
    help="Planner for guarded robots: a class, or the address of phalanx robot advise.",
)
@option("--keep", type=OUT_FOLDER, help="Keep the robots' files in this new folder. Default: delete them.")
@options.record_option
@options.json_option
@implemented_by("arena", "arena")
def arena() -> None:
    """Run the robots of SCENARIO as processes in a simulated field, in real time, and print a summary."""


@robot.command(epilog="Example: phalanx robot status robot-3.yaml --json")
@robot_argument
@options.json_option
@implemented_by("robot", "status")
def status() -> None:
    """Show a running robot's tokens, the audits that it answered and refused, and its delays."""


@robot.command(epilog="Example: phalanx robot log robot-3.yaml --out robot-3.mcap")
@robot_argument
@out_option("File for the recording.", metavar="FILE.mcap")
@implemented_by("evidence", "log")
def log() -> None:
    """Save the log of the last mission as a recording, for phalanx robot verify."""


@robot.command(epilog="Example: phalanx robot verify robot-3.mcap --json")
@click.argument("file", type=FILE, metavar="FILE")
@options.controller_option
@option(
    "--keys", type=FILE, metavar="FILE.keys", help="Key file of phalanx keys, to check the MACs of the trusted nodes."
)
@option("--key", "issued", type=FILE, metavar="MISSION.json", help="File of phalanx keys issue; needs --keys.")
@options.passphrase_option
@option("--trust", multiple=True, metavar="KEY", help="Trusted signer of the mission: 64 hex digits, or a PEM file.")
@options.json_option
@implemented_by("evidence", "verify")
def verify() -> None:
    """Replay the log in FILE, and print where the robot first deviated.

    FILE is a recording, or a daemon's own log. Exit with 1 if the robot deviated. Without --keys, the log is only what
    the robot's computer claims. With --keys, also exit with 1 if its trusted nodes' MACs do not prove the log, or if
    the mission is not the one that phalanx keys issue --mission signed.
    """


@robot.command(epilog="Example: phalanx robot schema > robot.schema.json")
@implemented_by("robot", "print_schema")
def schema() -> None:
    """Print the JSON schema of ROBOT.yaml, for editors."""
