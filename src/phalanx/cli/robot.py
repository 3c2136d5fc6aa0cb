"""Run a robot or its planner, load its keys, and print its state, for `phalanx robot`."""

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
from phalanx.daemon.state import is_running, read_state
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

HUNG_S = 1.0  # for processes that run a user's own code


def run(robot: Path) -> int:
    """Run one robot until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    with mistakes_in(*settings.own_files):
        run_until_stopped(run_robot(settings), HUNG_S)
    return 0


def ros2(robot: Path, namespace: str, ros: tuple[str, ...]) -> int:
    """Run one robot between topics of ROS 2, until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    with needs_ros2():
        from phalanx.bridges.ros2.node import RosBase  # noqa: PLC0415 - an extra
    job = run_robot(settings, make_base=partial(RosBase, namespace=namespace, arguments=ros))
    run_until_stopped(job, HUNG_S)
    return 0


def advise(
    mission: Path, planner: str, where: str, sign: Path | None, issued: Path | None, robots_at: tuple[str, ...]
) -> int:
    """Run a planner for robots of the mission, until Ctrl-C or SIGTERM."""
    scenario = find_scenario(str(mission))
    if scenario.controller != GUARD:
        raise UsageError(f"the mission's controller is {scenario.controller}", "only controller: guard takes advice")
    if (sign is None) != (issued is None):
        raise UsageError("--sign and --key need each other", "give both, or neither")
    signer = AdviceSigner(read_signing_key(sign), read_mission_number(issued)) if sign and issued else None
    named, signs = scenario.guard.adviser_key, signer.public.hex() if signer else ""
    if named.lower() != signs:
        what = "names no adviser_key" if not named else "names another adviser_key" if signs else "names an adviser_key"
        raise UsageError(f"the mission's guard {what}", "use --sign and --key for the named key (phalanx keys list)")
    make = find_planner(planner)
    assert make, "a planner is named"
    at = dict(_robot_at(words, scenario.robots) for words in robots_at)
    if at and not where.startswith("udp:"):
        raise UsageError(f"--robot with {where}", "use udp:ADDRESS:PORT: peers at a path have no address")
    adviser = Adviser(make, scenario.goal_m, scenario.robots, signer, lambda: time.monotonic() * 1000, at)
    with mistakes_in(planner):
        words = f"advises robots of {scenario.name} at {where}{', signed' if signer else ''}"
        run_until_stopped(advise_at(where, adviser, lambda: talk(words)), HUNG_S)
    return 0


def _robot_at(words: str, robots: int) -> tuple[int, str]:
    """Return the robot and its address in NUMBER=ADDRESS. Raises: UsageError: the text or the number is invalid."""
    number, _, address = words.partition("=")
    try:
        robot, at = int(number), str(ipaddress.ip_address(address))
    except ValueError as error:
        raise UsageError(f"--robot {words}", "use NUMBER=ADDRESS, such as 3=192.168.1.3") from error
    if not 1 <= robot <= robots:
        raise UsageError(f"--robot {words}", f"use a robot from 1 to {robots}")
    return robot, at


def provision(robot: Path, keys: Path, passphrase_file: Path | None) -> None:
    """Load the master key into a robot's trusted nodes, over their serial line."""
    settings = read_robot(robot)
    give_master_key(settings, keys, passphrase_of(keys, passphrase_file), today())
    talk(f"the trusted nodes of robot {settings.said.robot} have their master key permanently: {robot} needs no board")


def status(robot: Path, as_json: bool) -> int:
    """Print the state that a robot wrote last."""
    state = read_state(read_robot(robot).state_file)
    running = is_running(state)
    if as_json:
        print_json({**state, "running": running})
        return 0
    try:
        rows = _rows(state, running)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"the status file of {robot} is not that of a robot", f"start the robot: phalanx robot run {robot}"
        ) from error
    # The file can be forged: its control characters must not reach the terminal.
    print_rows({label: plain(words, 1000) for label, words in rows.items()})
    return 0


def _rows(state: dict[str, Any], running: bool) -> dict[str, str]:
    vouch = ", ".join(map(_token, state["tokens"])) or "no robot"
    refused = "; ".join(f"{each['auditee']}: {each['reason']}, {_ended(each)}" for each in state["refused"])
    given = "; ".join(f"{each['auditee']}: {_ended(each)}" for each in state["given"])
    longest = state["longest_ms"]
    return {
        "robot": f"{state['robot']}, mission {state['mission']}, {state['scenario']}, for {state['lived_s']:.0f} s",
        "state": _state(state, running),
        **({} if running else {"last update": f"{time.time() - state['told_s']:.0f} s ago; the rest is of that time"}),
        "vouched for by": f"{vouch}; {state['tokens_needed']} needed",
        "tokens given": given or "none",
        "tokens refused": refused or "none",
        "packets refused": ", ".join(f"{why}: {n}" for why, n in state["frames_refused"].items()) or "none",
        **({"advice": ", ".join(f"{what}: {n}" for what, n in state["advice"].items())} if state["advice"] else {}),
        "log": f"{state['log_bytes']} B, at most {state['log_bytes_max']} B",
        "longest times": ", ".join(f"{what} {took:.1f} ms" for what, took in longest.items()),
        "late readings": str(state["why_late"]) or "none by more than half of the limit",
        "CPU": f"{100 * state['cpu_share']:.1f} % of a core",
        "memory": memory_words(state),
    }


def grown_kb(state: dict[str, Any]) -> int:
    """Return the memory growth of a process since its mission began, from its state."""
    return int(state["memory_kb"]) - int(state["memory_began_kb"])


def memory_words(state: dict[str, Any]) -> str:
    """Return a process's memory use as text, from its state."""
    return f"{state['memory_kb'] / 1000:.1f} MB of memory, {grown_kb(state) / 1000:.1f} MB more than at the start"


def _state(state: dict[str, Any], running: bool) -> str:
    words = f"in Safe Mode: {state['why_stopped']}" if state["safe_mode"] else ""
    if running:
        missing = state["no_reading"]
        standing = missing and f"running, but standing still: no reading for {missing['for_s']:.1f} s: {missing['why']}"
        return words or standing or "running"
    # A robot that ended in order wrote the reason.
    ended = state["why_ended"] or "the process was killed, or its machine was switched off"
    return f"not running: {ended}" + (words and f"; it was {words}")


def _token(state: dict[str, Any]) -> str:
    return f"{state['auditor']} ({state['age_s']:.1f} s old, for {state['left_s']:.1f} s more)"


def _ended(state: dict[str, Any]) -> str:
    return f"{state['times']} times, {state['last_s_ago']:.1f} s ago"


def print_schema() -> None:
    """Print the JSON schema of ROBOT.yaml files."""
    click.echo(json.dumps(robot_schema(), indent=2, ensure_ascii=False))
