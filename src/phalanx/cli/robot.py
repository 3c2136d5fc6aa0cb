"""Run a robot or its planner, give it keys, and print its state, for `phalanx robot`."""

from __future__ import annotations

import ipaddress
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import click

from phalanx.daemon.advise import advise as advise_at
from phalanx.daemon.run import provision as give_master_key
from phalanx.daemon.run import run_robot
from phalanx.daemon.settings import read_robot, robot_schema
from phalanx.daemon.state import is_running, told
from phalanx.errors import UsageError
from phalanx.net.mission_key import read_mission_number
from phalanx.robot.planner import Adviser
from phalanx.robot.signer import AdviceSigner
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_planner, mistakes_in
from phalanx.scenarios.scenario import GUARD

from .credentials import passphrase_of, read_signing_key
from .keys import today
from .run import needs_ros2
from .run import run as run_until_stopped
from .terminal import plain, print_json, print_rows, talk

HUNG_S = 1.0  # of a process that runs somebody's own code


def run(robot: Path) -> int:
    """One robot, until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    with mistakes_in(*settings.own_files):
        run_until_stopped(run_robot(settings), HUNG_S)
    return 0


def ros2(robot: Path, namespace: str, ros: tuple[str, ...]) -> int:
    """One robot between topics of ROS 2, until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    with needs_ros2():
        from phalanx.bridges.ros2.node import RosBase  # noqa: PLC0415 - an extra
    job = run_robot(settings, make_base=partial(RosBase, namespace=namespace, arguments=ros))
    run_until_stopped(job, HUNG_S)
    return 0


def advise(
    mission: Path, planner: str, where: str, sign: Path | None, issued: Path | None, robots_at: tuple[str, ...]
) -> int:
    """A planner for robots of the mission, until Ctrl-C or SIGTERM."""
    scenario = find_scenario(str(mission))
    if scenario.controller != GUARD:
        raise UsageError(f"the mission's controller is {scenario.controller}", "controller: guard, which is advised")
    if (sign is None) != (issued is None):
        raise UsageError("--sign and --key belong together", "give both, or neither")
    signer = AdviceSigner(read_signing_key(sign), read_mission_number(issued)) if sign and issued else None
    named, signs = scenario.guard.adviser_key, signer.public.hex() if signer else ""
    if named.lower() != signs:
        what = "names no adviser_key" if not named else "names another adviser_key" if signs else "names an adviser_key"
        raise UsageError(
            f"the mission's guard {what}", "--sign and --key for the key that it names, as phalanx keys has it"
        )
    make = find_planner(planner)
    assert make, "as it is named"
    at = dict(_robot_at(words, scenario.robots) for words in robots_at)
    if at and not where.startswith("udp:"):
        raise UsageError(f"--robot beside {where}", "udp:ADDRESS:PORT: at a path nobody has an address")
    adviser = Adviser(make, scenario.goal_m, scenario.robots, signer, lambda: time.monotonic() * 1000, at)
    with mistakes_in(planner):
        words = f"advises robots of {scenario.name} at {where}{', signed' if signer else ''}"
        run_until_stopped(advise_at(where, adviser, lambda: talk(words)), HUNG_S)
    return 0


def _robot_at(words: str, robots: int) -> tuple[int, str]:
    """The robot and its address. Raises: UsageError: there is none such."""
    said, _, address = words.partition("=")
    try:
        robot, at = int(said), str(ipaddress.ip_address(address))
    except ValueError as error:
        raise UsageError(f"--robot {words}", "NUMBER=ADDRESS, as 3=192.168.1.3") from error
    if not 1 <= robot <= robots:
        raise UsageError(f"--robot {words}", f"robots are 1 to {robots}")
    return robot, at


def provision(robot: Path, keys: Path, passphrase_file: Path | None) -> None:
    """Its nodes' master key, over their line."""
    settings = read_robot(robot)
    give_master_key(settings, keys, passphrase_of(keys, passphrase_file), today())
    talk(f"the trusted nodes of robot {settings.said.robot} have their master key, for ever: {robot} needs no board")


def status(robot: Path, as_json: bool) -> int:
    """What a robot told last."""
    state = told(read_robot(robot).state_file)
    running = is_running(state)
    if as_json:
        print_json({**state, "running": running})
        return 0
    try:
        rows = _rows(state, running)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"no robot has written the status file that {robot} names", "phalanx robot run starts one"
        ) from error
    # The file may be anybody's, and is not to command the terminal.
    print_rows({label: plain(words, 1000) for label, words in rows.items()})
    return 0


def _rows(state: dict[str, Any], running: bool) -> dict[str, str]:
    vouch = ", ".join(map(_token, state["tokens"])) or "nobody"
    refused = "; ".join(f"{each['auditee']}: {each['reason']}, {_ended(each)}" for each in state["refused"])
    given = "; ".join(f"{each['auditee']}: {_ended(each)}" for each in state["given"])
    longest = state["longest_ms"]
    return {
        "robot": f"{state['robot']}, mission {state['mission']}, {state['scenario']}, for {state['lived_s']:.0f} s",
        "is": _is(state, running),
        **({} if running else {"last heard of": f"{time.time() - state['told_s']:.0f} s ago; the rest is of then"}),
        "vouched for by": f"{vouch}; {state['tokens_needed']} are needed",
        "tokens given": given or "none",
        "tokens refused": refused or "none",
        "frames refused": ", ".join(f"{why}: {n}" for why, n in state["frames_refused"].items()) or "none",
        **({"advice": ", ".join(f"{what}: {n}" for what, n in state["advice"].items())} if state["advice"] else {}),
        "log": f"{state['log_bytes']} B, at most {state['log_bytes_max']} B",
        "took at most": ", ".join(f"{what} {took:.1f} ms" for what, took in longest.items()),
        "latest": str(state["why_late"]) or "no reading by more than half of what is allowed",
        "of a core": f"{100 * state['cpu_share']:.1f} %",
        "in memory": memory_words(state),
    }


def grown_kb(told: dict[str, Any]) -> int:
    """Return by how much a process has grown since its mission began, from its state."""
    return int(told["memory_kb"]) - int(told["memory_began_kb"])


def memory_words(told: dict[str, Any]) -> str:
    """Return how much memory a process has, for people, from its state."""
    return f"{told['memory_kb'] / 1000:.1f} MB of memory, {grown_kb(told) / 1000:.1f} MB more than at its beginning"


def _is(state: dict[str, Any], running: bool) -> str:
    words = f"in Safe Mode: {state['why_stopped']}" if state["safe_mode"] else ""
    if running:
        missing = state["no_reading"]
        stands = missing and f"running, and stands: no reading for {missing['for_s']:.1f} s: {missing['why']}"
        return words or stands or "running"
    # Of who ended in order its file says why.
    ended = state["why_ended"] or "it was killed, or its machine went off"
    return f"not running: {ended}" + (words and f"; it was {words}")


def _token(told: dict[str, Any]) -> str:
    return f"{told['auditor']} ({told['age_s']:.1f} s old, for {told['left_s']:.1f} s more)"


def _ended(told: dict[str, Any]) -> str:
    return f"{told['times']} times, {told['last_s_ago']:.1f} s ago"


def print_schema() -> None:
    """The schema of robots' files."""
    click.echo(json.dumps(robot_schema(), indent=2, ensure_ascii=False))
