"""`phalanx robot`: one robot as a process of its own, and a world for such processes."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.complete import a_scenario, an_attack_by_robots
from phalanx.cli.options import FILE, OUT_FOLDER, option, out_option, runs

robot_argument = click.argument("robot", type=FILE, metavar="ROBOT.yaml")
SHARE = click.FloatRange(0, 0.9)


@click.group(epilog="Example: phalanx robot arena --robots 4 --attack hijack:robot=3,at=5")
def robot() -> None:
    """One robot outside of the simulator, as a process of its own, and a world for such robots."""


@robot.command(epilog="Example: phalanx robot run robot-3.yaml; docs/guides/robot.md says what the file may hold")
@robot_argument
@runs("robot", "run")
def run() -> None:
    """Run the robot in ROBOT.yaml until it is told to end. Without a new mission key its trusted nodes refuse."""


@robot.command(epilog="Example: phalanx robot ros2 robot-1.yaml --namespace r1 -- --ros-args -p ahead_m:=0.3")
@robot_argument
@click.argument("ros", nargs=-1, metavar="[-- ROS2 ARGUMENTS]")
@option("--namespace", default="", metavar="NAME", help="Of the robot's topics and node.")
@runs("robot", "ros2")
def ros2() -> None:
    """Run the robot in ROBOT.yaml, a guard between cmd_vel_raw and cmd_vel of ROS 2.

    It needs ROS 2: pip install '.[ros2]' in a clone.
    """


@robot.command(epilog="Example: phalanx robot advise mission.yaml planner.py:Home unix:advice")
@click.argument("mission", type=FILE)
@click.argument("planner", metavar="PLANNER.py:CLASS")
@click.argument("where", metavar="unix:PATH|udp:ADDRESS:PORT")
@option("--sign", type=FILE, metavar="ADVICE.pem", help="The key that the mission's adviser_key checks.")
@option("--key", "issued", type=FILE, metavar="MISSION.json", help="The mission's key as it was issued, with --sign.")
@option(
    "--robot",
    "robots_at",
    multiple=True,
    metavar="N=ADDRESS",
    help="From which address robot N asks, over UDP: from no other it is answered; again for another.",
)
@runs("robot", "advise")
def advise() -> None:
    """Run a planner as a process of its own, for robots whose file says planner: and where it listens."""


@robot.command(epilog="Example: phalanx robot provision robot-3.yaml lab.keys; phalanx keys create makes the latter")
@robot_argument
@click.argument("keys", type=FILE)
@options.passphrase_option
@runs("robot", "provision")
def provision() -> None:
    """Give the robot's trusted nodes their master key, of the file KEYS, once, over the line that ROBOT.yaml names."""


@robot.command(epilog="Example: phalanx robot arena --robots 8 --attack hijack:robot=3,at=10 --loss 0.2 --json")
@click.argument("scenario", default="flock-12", shell_complete=a_scenario)
@option("--robots", type=int, metavar="N", help="How many, each a process with a trusted process of its own.")
@option("--duration", "duration_s", type=float, metavar="S", help="Seconds, by the clock on the wall.")
@option("--f-max", type=int, metavar="F", help="The most compromised robots that are tolerated.")
@option("--seed", type=int, metavar="S", help="Of phases, of who is compromised, and of the weather.")
@option(
    "--attack",
    "attacks",
    help="One of phalanx attack list, or FILE.py:CLASS of your own; again for a further robot.",
    multiple=True,
    shell_complete=an_attack_by_robots,
    metavar="NAME|FILE.py:CLASS[:robot=I,at=T,…]",
)
@option("--sealed", is_flag=True, help="Robots' radios are sealed by their a-nodes.")
@option(
    "--on-air",
    multiple=True,
    metavar="NAME[:robot=I,at=T]",
    help="What a robot's radio does whatever its a-node says: past, replay, hold or foreign-key; again for another.",
)
@option(
    "--loss", type=SHARE, help="Share of frames that are lost; what is for one is tried again. Without, SCENARIO's."
)
@option("--repeats", type=SHARE, default=0.0, help="Share of frames that arrive twice.")
@option("--delay-ms", type=click.FloatRange(0, 10_000), default=5.0, help="Frames are late by up to so much.")
@option("--speed", type=click.FloatRange(0.05, 1), default=1.0, help="Share of real time, on a machine that is busy.")
@option("--cut", type=int, default=0, metavar="N", help="Cut the field in two: the first N robots, and the others.")
@option("--cut-at", "cut_at_s", type=float, default=10.0, metavar="S", help="When.")
@option(
    "--clock-ppm", type=int, default=0, metavar="PPM", help="Each robot's clock runs fast or slow by up to so much."
)
@options.controller_option
@option(
    "--planner",
    metavar="FILE.py:CLASS|unix:PATH|udp:ADDRESS:PORT",
    help="Who advises robots that the guard drives: a class, or where phalanx robot advise listens.",
)
@option("--keep", type=OUT_FOLDER, help="New folder for the robots' files, which are otherwise gone at the end.")
@options.record_option
@options.json_option
@runs("arena", "arena")
def arena() -> None:
    """Let robots of SCENARIO live as processes in a simulated field, in real time, and sum it up as sim run does."""


@robot.command(epilog="Example: phalanx robot status robot-3.yaml --json")
@robot_argument
@options.json_option
@runs("robot", "status")
def status() -> None:
    """Who vouches for the robot and for how long, which audits it gave, refused and why, and how late it ever was."""


@robot.command(epilog="Example: phalanx robot log robot-3.yaml --out robot-3.mcap")
@robot_argument
@out_option("The recording.", metavar="FILE.mcap")
@runs("evidence", "log")
def log() -> None:
    """Write down all that the robot logged in its last mission, which verify goes through."""


@robot.command(epilog="Example: phalanx robot verify robot-3.mcap --json")
@click.argument("file", type=FILE, metavar="FILE")
@options.controller_option
@option("--keys", type=FILE, metavar="FILE.keys", help="The owner's keys, to check what its trusted nodes said of it.")
@option("--key", "issued", type=FILE, metavar="MISSION.json", help="The mission's key as it was issued, with --keys.")
@options.passphrase_option
@option("--trust", multiple=True, metavar="KEY", help="Who must have signed its mission: 64 hex digits, or a PEM file.")
@options.json_option
@runs("evidence", "verify")
def verify() -> None:
    """Go through the log in FILE again, a recording or a daemon's own, and say where it stops being honest.

    Ends with 1 if it does. Without --keys it is what the robot's computer says that it logged; with them, up to where
    its trusted nodes' own MACs bear it out, and it ends with 1 if they do not. So it does where its mission is not
    what phalanx keys issue --mission signed.
    """


@robot.command(epilog="Example: phalanx robot schema > robot.schema.json")
@runs("robot", "print_schema")
def schema() -> None:
    """The JSON schema of robots' files, for editors."""
