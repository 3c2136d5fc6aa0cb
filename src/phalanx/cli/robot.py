"""What `phalanx robot` does."""

from __future__ import annotations

import contextlib
import ipaddress
import json
import tempfile
import time
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from phalanx.daemon.advise import advise as advise_at
from phalanx.daemon.arena import Minds, play_in_arena
from phalanx.daemon.ether import Weather
from phalanx.daemon.evidence import read_kept, record_log
from phalanx.daemon.on_air import Air, parse_on_air
from phalanx.daemon.proofs import Proven, mission_key_of, proven
from phalanx.daemon.run import provision as give_master_key
from phalanx.daemon.run import run_robot
from phalanx.daemon.settings import read_robot, robot_schema
from phalanx.daemon.signers import signed_in
from phalanx.daemon.state import is_running, told
from phalanx.errors import UsageError
from phalanx.io.mission_key import read_mission_number
from phalanx.robot.adviser import Adviser
from phalanx.robot.signer import AdviceSigner
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks, find_controller, find_planner, mistakes_in
from phalanx.scenarios.scenario import GUARD
from phalanx.sim.scenarios.play import ctrl_c_between_steps
from phalanx.sim.scenarios.recording import Recording
from phalanx.sim.scenarios.run import Run

from . import sim
from .keys import passphrase_of, today
from .mission.files import read_signing_key, read_trusted
from .run import run as run_until_stopped
from .terminal import end_status_line, plain, print_json, print_rows, talk


def run(robot: Path) -> int:
    """One robot, until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    said = settings.said
    own = (said.driver.removeprefix("python:"), said.planner, said.controller)  # what is no file, does nothing
    with mistakes_in(*(str(settings.path(each)) for each in own if each)):
        run_until_stopped(run_robot(settings))
    return 0


def ros2(robot: Path, namespace: str, ros: tuple[str, ...]) -> int:
    """One robot between topics of ROS 2, until Ctrl-C or SIGTERM."""
    settings = read_robot(robot)
    try:
        from phalanx.daemon.ros2.node import RosBase  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise UsageError(f"ROS 2 is not installed: {error}", "pip install 'phalanx-swarm[ros2]'") from error
    run_until_stopped(run_robot(settings, make_base=partial(RosBase, namespace=namespace, arguments=ros)))
    return 0


def advise(
    mission: Path, planner: str, where: str, sign: Path | None, issued: Path | None, robots_at: tuple[str, ...]
) -> int:
    """A planner for robots of the mission, until Ctrl-C or SIGTERM."""
    scenario = find_scenario(str(mission))
    if scenario.controller != GUARD:
        raise UsageError(f"the mission's controller is {scenario.controller}", "controller: guard, which is advised")
    if (sign is None) != (issued is None):
        raise UsageError("one of --sign and --key", "both, or neither")
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
        run_until_stopped(advise_at(where, adviser, lambda: talk(words)))
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


def arena(
    scenario: str,
    attacks: tuple[str, ...],
    on_air: tuple[str, ...],
    sealed: bool,
    loss: float | None,
    controller: str | None,
    planner: str | None,
    keep: Path | None,
    record: Path | None,
    as_json: bool,
    **said: Any,
) -> int:
    """Robots as processes, summed up on stdout."""
    weather = Weather(**{each.name: said.pop(each.name) for each in fields(Weather)})
    liars = find_attacks(attacks) if attacks else None
    chosen = sim.changed(find_scenario(scenario), said, attacks=liars)
    chosen, own = find_controller(controller, chosen, in_python=True)
    if loss is not None:
        chosen = replace(chosen, radio=replace(chosen.radio, loss=loss))
    air = Air(sealed, tuple(parse_on_air(each, chosen.robots) for each in on_air))
    sim.warn(chosen)
    with contextlib.ExitStack() as stack:
        folder = _folder(keep, stack)
        tell, check = sim.progress(chosen.duration_s), stack.enter_context(ctrl_c_between_steps())

        def on_step(run: Run) -> None:
            tell(run)
            check()

        recording = stack.enter_context(Recording(record, chosen)) if record else None
        minds = Minds(own, _beside(controller) if own else "", _beside(planner) if planner else "", attacks)
        try:
            with mistakes_in(controller, planner, *attacks):
                field = play_in_arena(chosen, folder, weather, on_step, recording, air, minds)
        except KeyboardInterrupt:
            end_status_line()
            click.echo("stopped", err=True)
            return 1
    end_status_line()
    summary = field.summary()
    if as_json:
        print_json(summary)
    else:
        sim.show(chosen, summary)
        shares = [each["core_share"] for each in summary["processes"] if "core_share" in each]
        late = [each["longest_ms"]["late"] for each in summary["processes"] if "longest_ms" in each]
        for each in summary["on_air"]:
            at_s = each["safe_mode_s"]
            stopped = "never in Safe Mode" if at_s is None else f"in Safe Mode at {at_s:.1f} s"
            print_rows({f"{each['attack']}, robot {each['robot']}": stopped})
        if shares:
            words = f"{100 * max(shares):.1f} % of a core at most, its readings up to {max(late):.0f} ms late, "
            words += _memory(max((each for each in summary["processes"] if "memory_kb" in each), key=_grown_kb))
            print_rows({"a daemon takes": words})
    for robot, at_s in sorted(field.failed_s.items()):
        words = f"robot {robot} ended by a mistake, told above, within {at_s:.0f} s: nobody stopped it"
        click.echo(f"phalanx: error: {words}", err=True)
    return int(bool(field.failed_s))


def _beside(words: str | None) -> str:
    """FILE.py:CLASS, or unix:PATH, as it is called from any folder."""
    kind, colon, rest = str(words).partition(":")
    if kind in ("unix", "udp"):
        return f"unix:{Path(rest).resolve()}" if kind == "unix" else str(words)
    return f"{Path(kind).resolve()}{colon}{rest}"


def _folder(keep: Path | None, stack: contextlib.ExitStack) -> Path:
    if keep is None:
        return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="phalanx-")))
    try:
        keep.mkdir(mode=0o700)
    except FileExistsError as error:
        raise UsageError(f"{keep} is there already", "another name: keys are never overwritten") from error
    except OSError as error:
        raise UsageError(f"cannot make {keep}: {error.strerror}", "a folder that is yours") from error
    return keep


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
            f"no robot's state is in the file that {robot} names", "phalanx robot run starts one"
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
        "vouched for by": f"{vouch}; {state['tokens_needed']} are needed",
        "tokens given": given or "none",
        "tokens refused": refused or "none",
        "frames refused": ", ".join(f"{why}: {n}" for why, n in state["frames_refused"].items()) or "none",
        **({"advice": ", ".join(f"{what}: {n}" for what, n in state["advice"].items())} if state["advice"] else {}),
        "log": f"{state['log_bytes']} B, at most {state['log_bytes_max']} B",
        "took at most": ", ".join(f"{what} {took:.1f} ms" for what, took in longest.items()),
        "latest": str(state["why_late"]) or "no reading by more than half of what is allowed",
        "of a core": f"{100 * state['core_share']:.1f} %",
        "in memory": _memory(state),
    }


def _grown_kb(told: dict[str, Any]) -> int:
    return int(told["memory_kb"]) - int(told["memory_began_kb"])


def _memory(told: dict[str, Any]) -> str:
    return f"{told['memory_kb'] / 1000:.1f} MB of memory, {_grown_kb(told) / 1000:.1f} MB more than at its beginning"


def _is(state: dict[str, Any], running: bool) -> str:
    words = f"in Safe Mode: {state['why_stopped']}" if state["safe_mode"] else ""
    return (words or "running") if running else "not running" + (words and f"; it was {words}")


def _token(told: dict[str, Any]) -> str:
    return f"{told['auditor']} ({told['age_s']:.1f} s old, for {told['left_s']:.1f} s more)"


def _ended(told: dict[str, Any]) -> str:
    return f"{told['times']} times, {told['last_s_ago']:.1f} s ago"


def print_schema() -> None:
    """The schema of robots' files."""
    click.echo(json.dumps(robot_schema(), indent=2, ensure_ascii=False))


def log(robot: Path, out: Path) -> int:
    """All that a robot logged in its mission, as a recording."""
    count = record_log(read_robot(robot).log_file, out)
    talk(f"{out}: {count} entries")
    return 0


def verify(
    file: Path,
    controller: str | None,
    keys: Path | None,
    issued: Path | None,
    passphrase_file: Path | None,
    trust: tuple[str, ...],
    as_json: bool,
) -> int:
    """Whether a log is an honest robot's, and where not; with keys, whether it is what its trusted nodes saw."""
    if (keys is None) != (issued is None):
        raise UsageError("one of --keys and --key", "both, or neither")
    trusted = [read_trusted(each).hex() for each in trust]
    kept = read_kept(file)
    signer = kept.mission_signer
    of_mission, is_as_signed = _mission_of(signer, kept.signed is not None, trusted)
    scenario, own = find_controller(controller, kept.scenario, in_python=True)
    kept = replace(kept, scenario=scenario)
    borne: Proven | None = None
    if keys and issued:
        borne = proven(kept, mission_key_of(kept, keys, passphrase_of(keys, passphrase_file), issued))
    with mistakes_in(controller):
        found, entries = kept.first_lie(own), len(kept.entries())
    signed = signed_in(kept)
    at_s = None if found is None else (found.t_ms - kept.t_key_ms) / 1000
    reason = "" if found is None else found.refusal.name.lower().replace("_", " ")
    if as_json:
        print_json(
            {
                "robot": kept.robot,
                "mission": kept.mission,
                "entries": entries,
                "honest": found is None,
                "entry": None if found is None else found.entry,
                "at_s": at_s,
                "reason": reason or None,
                "mission_signer": signer or None,
                "proven_entries": None if borne is None else borne.entries,
                "disproved_at": None if borne is None else borne.false_at,
                "signed": [asdict(each) for each in signed],
            }
        )
    else:
        words = "honest" if found is None else f"FAULT at entry {found.entry}, {at_s:.3f} s: {reason}"
        click.echo(f"robot {kept.robot}   mission {kept.mission}   {entries} entries   {words}{_borne(borne)}")
        click.echo(of_mission)
        for each in signed:
            key = f" ({each.key})" if each.key else ""
            click.echo(f"told {each.count} times from {each.first_s:.1f} to {each.last_s:.1f} s by {each.signer}{key}")
    return int(found is not None or (borne is not None and not borne.holds) or not is_as_signed)


def _mission_of(by: str, is_signed: bool, trusted: list[str]) -> tuple[str, bool]:
    """Whose word it is that the log's mission is the robot's, and whether that is as it should be."""
    if is_signed and not by:
        return "its mission is NOT THE ONE THAT WAS SIGNED", False
    if trusted and by not in trusted:
        return (f"its mission was signed by {by}, WHO IS NOT TRUSTED" if by else "NOBODY SIGNED ITS MISSION"), False
    return (f"its mission was signed by {by}" if by else "its mission is its own word: nobody signed it"), True


def _borne(borne: Proven | None) -> str:
    if borne is None:
        return ""
    if borne.false_at is not None:
        return f"   NOT WHAT ITS TRUSTED NODES SAW by entry {borne.false_at}; proven: the first {borne.entries}"
    return f"   proven by its trusted nodes: the first {borne.entries}" if borne.holds else "   NOTHING IS PROVEN"
