"""Run `phalanx robot arena`: robots as processes in a simulated field."""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from phalanx.daemon.on_air import parse_on_air
from phalanx.errors import UsageError
from phalanx.lab.arena.arena import play_in_arena
from phalanx.lab.arena.ether import RadioConditions
from phalanx.lab.arena.places import Changes
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks, find_controller, mistakes_in
from phalanx.scenarios.scenario import PROTOCOLS
from phalanx.world.scenarios.play import ctrl_c_between_steps
from phalanx.world.scenarios.recording import Recording
from phalanx.world.scenarios.run import Run

from . import sim
from .robot import grown_kb, memory_words
from .terminal import end_status_line, print_json, print_rows, stopped


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
    **options: Any,
) -> int:
    """Run the robots of a scenario as processes, and print a summary. Return 1 if a process failed."""
    conditions = RadioConditions(**{each.name: options.pop(each.name) for each in fields(RadioConditions)})
    chosen_attacks = find_attacks(attacks) if attacks else None
    chosen = sim.apply_options(find_scenario(scenario), options, attacks=chosen_attacks)
    chosen, own = find_controller(controller, chosen, in_python=True)
    if loss is not None:
        chosen = replace(chosen, radio=replace(chosen.radio, loss=loss))
    changes = Changes(
        make=own,
        controller=_beside(controller) if own else "",
        planner=_beside(planner) if planner else "",
        attacks=attacks,
        sealed=sealed,
        on_air=tuple(parse_on_air(each, chosen.robots) for each in on_air),
    )
    sim.print_cautions(chosen)
    with contextlib.ExitStack() as stack:
        folder = _folder(keep, stack)
        show_progress, check = sim.progress(chosen.duration_s), stack.enter_context(ctrl_c_between_steps())

        def on_step(run: Run) -> None:
            show_progress(run)
            check()

        recording = stack.enter_context(Recording(record, chosen)) if record else None
        try:
            with mistakes_in(controller, planner, *attacks):
                field = play_in_arena(chosen, folder, conditions, on_step, recording, changes)
        except KeyboardInterrupt:
            return stopped()
    end_status_line()
    summary = field.summary()
    if as_json:
        print_json(summary)
    else:
        sim.show(chosen, summary, knows_goal=not own and chosen.controller not in PROTOCOLS)
        shares = [each["cpu_share"] for each in summary["processes"] if "cpu_share" in each]
        late = [each["longest_ms"]["late"] for each in summary["processes"] if "longest_ms" in each]
        for each in summary["on_air"]:
            at_s = each["safe_mode_s"]
            ended = "never in Safe Mode" if at_s is None else f"in Safe Mode at {at_s:.1f} s"
            print_rows({f"{each['attack']}, robot {each['robot']}": ended})
        if shares:
            words = f"{100 * max(shares):.1f} % of a core at most, readings up to {max(late):.0f} ms late, "
            words += memory_words(max((each for each in summary["processes"] if "memory_kb" in each), key=grown_kb))
            print_rows({"per daemon": words})
    for robot, (how, at_s) in sorted(field.failed.items()):
        click.echo(f"phalanx: error: robot {robot} {how}, within {at_s:.0f} s, without being stopped", err=True)
    return int(bool(field.failed))


def _beside(words: str | None) -> str:
    """Return FILE.py:CLASS or unix:PATH with an absolute path, valid in any working directory."""
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
        raise UsageError(f"{keep} exists", "use another name: existing keys are never overwritten") from error
    except OSError as error:
        raise UsageError(f"cannot create {keep}: {error.strerror}", "use a folder that you can write to") from error
    return keep
