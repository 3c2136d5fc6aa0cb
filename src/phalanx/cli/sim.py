"""`phalanx sim`: run a scenario, list those that come with it, print the schema of their files."""

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
from phalanx.world.scenarios.cautions import cautions
from phalanx.world.scenarios.play import play
from phalanx.world.scenarios.run import Run

from .terminal import Progress, counted, end_status_line, print_json, print_rows, said_aside, stopped

# What people typed, for what a scenario calls otherwise.
TYPED = {
    "grid_step_m": "--spacing",
    "spacing_m": "--spacing",
    "duration_s": "--duration",
    "f_max": "--f-max",
    "t_audit_s": "--t-audit",
    "t_val_s": "--t-val",
    "seed": "--seed",
}


def changed(scenario: Scenario, said: dict[str, Any], **more: Any) -> Scenario:
    """The scenario with what `swarm_options` were given. Raises: UsageError: as for the scenario."""
    try:
        return scenario.with_options(**said, **more)
    except UsageError as error:
        said_as = re.sub(r"^\w+(?= is )", lambda field: TYPED.get(field[0], field[0]), str(error))
        raise UsageError(said_as, error.hint) from error


@dataclass(frozen=True, slots=True)
class Chosen:
    """A scenario to run, a researcher's own controller and planner or None, and their files."""

    scenario: Scenario
    controller: Callable[[int], Controller] | None
    planner: MakePlanner | None
    files: tuple[str | None, ...]

    @property
    def is_own(self) -> bool:
        """Return whether the controller is of a researcher's file."""
        return self.controller is not None or is_file(self.scenario.controller)


def choose(
    scenario: str, defence: Any, attacks: tuple[str, ...], controller: str | None, planner: str | None, **said: Any
) -> Chosen:
    """Return what the options of `chosen_options` name. Raises: UsageError, Unavailable: one names nothing usable."""
    with said_aside():
        liars = find_attacks(attacks) if attacks else None
        found, own = find_controller(controller, changed(find_scenario(scenario), said, defence=defence, attacks=liars))
        return Chosen(found, own, find_planner(planner), (controller, planner, *attacks))


def run(scenario: str, record: Path | None, trace: tuple[str, ...], plain: bool, as_json: bool, **said: Any) -> int:
    """Run a scenario and sum it up on stdout; 1 if a correct robot that had a quorum was stopped."""
    traced = _traced(trace) if trace else None
    lines = sys.stderr if as_json else sys.stdout  # before a controller's own words are turned aside
    before = _written(record)
    chosen = choose(scenario, **said)
    warn(chosen.scenario)
    tell = progress(chosen.scenario.duration_s) if traced is None else lambda _run: None

    def on_start(started: Run) -> None:
        if traced is not None:
            started.trace(traced, lambda line: click.echo(line, file=lines))

    try:
        with said_aside(), mistakes_in(*chosen.files):
            ended = play(
                chosen.scenario,
                record,
                tell,
                chosen.controller,
                planner=chosen.planner,
                plain=plain,
                on_start=on_start,
            )
    except KeyboardInterrupt:
        return stopped(f"recorded until then: {record}" if _written(record) != before else "")
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
        click.echo(f"phalanx: correct robots that had a quorum were stopped: {named(wronged)}", err=True)
        if chosen.is_own:
            click.echo(f"phalanx: hint: phalanx sim check {chosen.files[0]}", err=True)
    return int(bool(wronged))


def check(controller: str, seed: int, as_json: bool) -> int:
    """Check that a controller can be audited, print where it differs, and return 1 if it does."""
    from phalanx.lab.determinism.check import check_controller  # noqa: PLC0415 - only this needs it

    with said_aside():
        report = check_controller(controller, seed)
    if as_json:
        print_json(report.as_json())
    else:
        rows = {each.name: "yes" if each.finding is None else f"NO: {each.finding}" for each in report.checks}
        print_rows({"controller": f"{report.controller}: {report.calls} calls, seed {report.seed}"} | rows)
    return 0 if report.agrees else 1


def _traced(said: tuple[str, ...]) -> int:
    """Return the robot of `--trace robot=5`. Raises: UsageError: it is written otherwise, or several are named."""
    if len(said) > 1:
        raise UsageError(f"--trace {' --trace '.join(said)}", "one robot a run")
    (words,) = said
    found = re.fullmatch(r"robot=(\d{1,5})", words)
    if not found:
        raise UsageError(f"--trace {words}", "--trace robot=5: the number of one robot")
    return int(found[1])


def _written(record: Path | None) -> int:
    """When the recording was written last, ns; 0 if it is not there: a run may be stopped before its first step."""
    return record.stat().st_mtime_ns if record and record.exists() else 0


def warn(scenario: Scenario) -> None:
    """A line on stderr for each thing by which the scenario can hardly end well."""
    for words in cautions(scenario):
        click.echo(f"phalanx: warning: {words}", err=True)


def progress(duration_s: float, label: str = "") -> Callable[[Run], None]:
    """Progress on stderr."""
    so_far = Progress()

    def tell(run: Run) -> None:
        stopped = counted(int(run.in_safe_mode.sum()), "robot")
        text = f"{label}{run.now_s:.0f} of {duration_s:g} s simulated, {stopped} in Safe Mode"
        so_far.tell(text, run.now_s / duration_s)

    return tell


def show(scenario: Scenario, summary: dict[str, Any], *, knows_goal: bool = True) -> None:
    """Print a run's summary for people, without the goal where only the controller knows where it goes.

    Robots that obey orders have no goal, and their bodies none of the sizes by which contacts count.
    """
    is_driven = scenario.controller == WHEELS
    to_goal = told(summary["mean_distance_to_goal_m"], ".1f", " m, mean of the correct robots")
    rows = {
        "scenario": f"{scenario.name}: {summary['robots']} robots, {summary['duration_s']:g} s, "
        f"defence {summary['defence']}, seed {summary['seed']}",
        **({"distance to the goal": to_goal} if knows_goal and not is_driven else {}),
        **{
            name: "nothing to count yet" if done is None else f"{done:g}, of correct robots"
            for name, done in summary.get("task", {}).items()
        },
        "compromised": "; ".join(map(_liar, summary["compromised"])) or "nobody",
        "stopped with a quorum": named(summary["correct_in_safe_mode"]),
        "stopped, no quorum": named(summary["without_quorum"]),
        **({} if is_driven else {"contacts": str(summary["contacts"])}),
        "sent": "{app:.0f} B/s a robot by the flock, {audit:.0f} by the audits, each try counted".format(
            **summary["tried_bytes_per_s_per_robot"]
        ),
        "on the air": "{app:.2f} % of the time a robot for the flock, {audit:.2f} for the audits".format(
            **summary["airtime_pct_per_robot"]
        ),
        "longest log": f"{summary['log_bytes_max']} B",
        "delivered": f"{told(summary['broadcast_delivery'], '.4f')} of broadcasts, "
        f"{told(summary['unicast_delivery'], '.4f')} of unicasts",
        "speed": _speed(summary["real_time_factor"]),
        "digest": summary["digest"] or "-",
    }
    print_rows(rows)


def told(value: float | None, form: str, unit: str = "") -> str:
    """A number, or a dash where there is none."""
    return "-" if value is None else f"{value:{form}}{unit}"


def _speed(factor: float | None) -> str:
    """Return a speed with three digits that count, written out: 1 720 times real time."""
    return "-" if factor is None else f"{float(f'{factor:.3g}'):,g} times real time".replace(",", " ")


def _liar(liar: dict[str, Any]) -> str:
    began, stopped = liar["first_deviation_s"], liar["safe_mode_s"]
    deviated = "never deviated in its log" if began is None else f"deviated at {began:.2f} s"
    ended = "never stopped" if stopped is None else f"in Safe Mode at {stopped:.2f} s"
    return f"robot {liar['robot']} ({liar['attack']}) {deviated}, {ended}"


def named(ids: Sequence[int]) -> str:
    """Return robots by their ids, which nobody can take for a count."""
    which = ", ".join(map(str, ids))
    return f"robot{'s' * (len(ids) > 1)} {which}" if which else "none"
