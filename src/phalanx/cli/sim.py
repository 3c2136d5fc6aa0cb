"""`phalanx sim`: run scenarios and check controllers."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from phalanx.errors import UsageError
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.planner import MakePlanner
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks, find_controller, find_planner, is_file, mistakes_in
from phalanx.scenarios.scenario import PROTOCOLS, WHEELS, Scenario
from phalanx.world.scenarios.cautions import audit_warnings
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run

from .terminal import Progress, count_of, end_status_line, print_json, print_rows, stdout_to_stderr, stopped

# The options of scenario fields with another name.
TYPED = {
    "grid_step_m": "--spacing",
    "spacing_m": "--spacing",
    "duration_s": "--duration",
    "f_max": "--f-max",
    "t_audit_s": "--t-audit",
    "t_val_s": "--t-val",
    "seed": "--seed",
}


def apply_options(scenario: Scenario, options: dict[str, Any], **more: Any) -> Scenario:
    """Return the scenario, changed by `swarm_options`. Raises: UsageError: as for the scenario."""
    try:
        return scenario.with_options(**options, **more)
    except UsageError as error:
        message = re.sub(r"^\w+(?= is )", lambda field: TYPED.get(field[0], field[0]), str(error))
        raise UsageError(message, error.hint) from error


@dataclass(frozen=True, slots=True)
class Chosen:
    """A scenario to run, with the user's own controller and planner, or None, and the files they come from."""

    scenario: Scenario
    controller: Callable[[int], Controller] | None
    planner: MakePlanner | None
    files: tuple[str | None, ...]

    @property
    def is_own(self) -> bool:
        """Return whether the controller comes from a user's file."""
        return self.controller is not None or is_file(self.scenario.controller)


def choose(
    scenario: str, defence: Any, attacks: tuple[str, ...], controller: str | None, planner: str | None, **options: Any
) -> Chosen:
    """Return the scenario, controller and planner that `chosen_options` name. Raises: UsageError, Unavailable."""
    with stdout_to_stderr():
        chosen_attacks = find_attacks(attacks) if attacks else None
        wanted = apply_options(find_scenario(scenario), options, defence=defence, attacks=chosen_attacks)
        found, own = find_controller(controller, wanted)
        return Chosen(found, own, find_planner(planner), (controller, planner, *attacks))


def run(scenario: str, record: Path | None, trace: tuple[str, ...], plain: bool, as_json: bool, **options: Any) -> int:
    """Run a scenario and print a summary. Return 1 if a correct robot with a quorum was stopped."""
    traced = _traced(trace) if trace else None
    lines = sys.stderr if as_json else sys.stdout  # before stdout is redirected for the controller
    before = _written(record)
    chosen = choose(scenario, **options)
    print_cautions(chosen.scenario)
    tell = progress(chosen.scenario.duration_s) if traced is None else lambda _run: None

    def on_start(started: Run) -> None:
        if traced is not None:
            started.trace(traced, lambda line: click.echo(line, file=lines))

    try:
        with stdout_to_stderr(), mistakes_in(*chosen.files):
            ended = run_scenario(
                chosen.scenario,
                record,
                tell,
                chosen.controller,
                planner=chosen.planner,
                plain=plain,
                on_start=on_start,
            )
    except KeyboardInterrupt:
        return stopped(f"recorded so far: {record}" if _written(record) != before else "")
    end_status_line()
    summary = ended.summary()
    if as_json:
        print_json(summary)
    else:
        knows_goal = not chosen.is_own and chosen.scenario.controller not in PROTOCOLS
        show(chosen.scenario, summary, knows_goal=knows_goal)
    if record:
        click.echo(f"recorded: {record}", err=True)
    wronged = summary["correct_in_safe_mode"]
    if wronged:
        click.echo(f"phalanx: correct robots with a quorum were stopped: {format_robots(wronged)}", err=True)
        if chosen.is_own:
            click.echo(f"phalanx: hint: phalanx sim check {chosen.files[0]}", err=True)
    return int(bool(wronged))


def check(controller: str, seed: int, as_json: bool) -> int:
    """Check that auditors can replay a controller, print where its outputs differ, and return 1 if they do."""
    from phalanx.lab.determinism.check import check_controller  # noqa: PLC0415 - needed here only

    with stdout_to_stderr():
        report = check_controller(controller, seed)
    if as_json:
        print_json(report.as_json())
    else:
        rows = {each.name: "yes" if each.finding is None else f"NO: {each.finding}" for each in report.checks}
        print_rows({"controller": f"{report.controller}: {report.calls} calls, seed {report.seed}"} | rows)
    return 0 if report.agrees else 1


def _traced(texts: tuple[str, ...]) -> int:
    """Return the robot of `--trace robot=5`. Raises: UsageError: invalid, or several robots."""
    if len(texts) > 1:
        raise UsageError(f"--trace {' --trace '.join(texts)}", "trace one robot per run")
    (words,) = texts
    found = re.fullmatch(r"robot=(\d{1,5})", words)
    if not found:
        raise UsageError(f"--trace {words}", "give the number of one robot, such as --trace robot=5")
    return int(found[1])


def _written(record: Path | None) -> int:
    """Return the modification time of the recording, ns, or 0 if missing: a run can stop before its first step."""
    return record.stat().st_mtime_ns if record and record.exists() else 0


def print_cautions(scenario: Scenario) -> None:
    """Print a warning on stderr for each setting with which the scenario is likely to fail."""
    for words in audit_warnings(scenario):
        click.echo(f"phalanx: warning: {words}", err=True)


def progress(duration_s: float, label: str = "") -> Callable[[Run], None]:
    """Return a function that shows a run's progress on stderr."""
    so_far = Progress()

    def tell(run: Run) -> None:
        stopped = count_of(int(run.in_safe_mode.sum()), "robot")
        text = f"{label}{run.now_s:.0f} of {duration_s:g} s simulated, {stopped} in Safe Mode"
        so_far.tell(text, run.now_s / duration_s)

    return tell


def show(scenario: Scenario, summary: dict[str, Any], *, knows_goal: bool = True) -> None:
    """Print the summary of a run, without the goal if only the controller knows it.

    Robots that follow orders have no goal, and no sizes from which contacts could be counted.
    """
    is_driven = scenario.controller == WHEELS
    to_goal = format_number(summary["mean_distance_to_goal_m"], ".1f", " m, mean of the correct robots")
    rows = {
        "scenario": f"{scenario.name}: {summary['robots']} robots, {summary['duration_s']:g} s, "
        f"defence {summary['defence']}, seed {summary['seed']}",
        **({"distance to the goal": to_goal} if knows_goal and not is_driven else {}),
        **{
            name: "nothing to count yet" if done is None else f"{done:g}, of correct robots"
            for name, done in summary.get("task", {}).items()
        },
        "compromised": "; ".join(map(_liar, summary["compromised"])) or "none",
        "stopped with a quorum": format_robots(summary["correct_in_safe_mode"]),
        "stopped, no quorum": format_robots(summary["without_quorum"]),
        **({} if is_driven else {"contacts": str(summary["contacts"])}),
        "sent": "{app:.0f} B/s per robot by the flock, {audit:.0f} by the audits, retries included".format(
            **summary["tried_bytes_per_s_per_robot"]
        ),
        "on the air": "{app:.2f} % of the time per robot for the flock, {audit:.2f} for the audits".format(
            **summary["airtime_pct_per_robot"]
        ),
        "longest log": f"{summary['log_bytes_max']} B",
        "delivered": f"{format_number(summary['broadcast_delivery'], '.4f')} of broadcasts, "
        f"{format_number(summary['unicast_delivery'], '.4f')} of unicasts",
        "speed": _speed(summary["real_time_factor"]),
        "digest": summary["digest"] or "-",
    }
    print_rows(rows)


def format_number(value: float | None, form: str, unit: str = "") -> str:
    """Format a number, or return a dash for None."""
    return "-" if value is None else f"{value:{form}}{unit}"


def _speed(factor: float | None) -> str:
    """Return a speed with three significant digits, written out: 1 720 times real time."""
    return "-" if factor is None else f"{float(f'{factor:.3g}'):,g} times real time".replace(",", " ")


def _liar(liar: dict[str, Any]) -> str:
    began, stopped = liar["first_deviation_s"], liar["safe_mode_s"]
    deviated = "never deviated in its log" if began is None else f"deviated at {began:.2f} s"
    ended = "never stopped" if stopped is None else f"in Safe Mode at {stopped:.2f} s"
    return f"robot {liar['robot']} ({liar['attack']}) {deviated}, {ended}"


def format_robots(ids: Sequence[int]) -> str:
    """Return robots by their ids, such as "robots 3, 5": a bare 3 could be taken for a count."""
    which = ", ".join(map(str, ids))
    return f"robot{'s' * (len(ids) > 1)} {which}" if which else "none"
