"""Run a scenario from beginning to end, with callbacks and an optional recording."""

from __future__ import annotations

import contextlib
import math
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.planner import MakePlanner
from phalanx.scenarios.scenario import Scenario
from phalanx.world.signals import handled_by

from .run import Run

# The robots' control period.
STEP_S = 0.25
# Written directly to the file descriptor, because a signal may interrupt a write of the file object.
STOPPING = b"\nphalanx: stopping after this step; Ctrl-C again ends it at once\n"
TINY = 1e-9  # avoids an empty last step because of rounding, as in 0.3 / 0.1 > 3


@contextlib.contextmanager
def ctrl_c_between_steps() -> Iterator[Callable[[], None]]:
    """Defer Ctrl-C and SIGTERM until the yielded function is called, which raises KeyboardInterrupt.

    A second signal takes effect at once. Each step is recorded completely. Outside the main thread, which alone gets
    signals, this does nothing.
    """
    waiting: list[int] = []

    def keep(number: int, frame: FrameType | None) -> None:
        if waiting:
            signal.default_int_handler(number, frame)
        waiting.append(number)
        if number == signal.SIGINT:
            os.write(2, STOPPING)

    def check() -> None:
        if waiting:
            raise KeyboardInterrupt

    with handled_by(keep, signal.SIGINT, signal.SIGTERM):
        yield check


def run_scenario(
    scenario: Scenario,
    record: Path | None = None,
    on_step: Callable[[Run], None] = lambda _run: None,
    controller: Callable[[int], Controller] | None = None,
    step_s: float = STEP_S,
    *,
    planner: MakePlanner | None = None,
    plain: bool = False,
    on_start: Callable[[Run], None] = lambda _run: None,
) -> Run:
    """Run the scenario to its end, and return the run.

    Args:
        record: MCAP file to write, or None.
        on_step: called each `step_s` from 0 on, and at the end; an exception ends the run, with a complete recording.
        controller: a user's own, made from each robot's id; None for the scenario's bundled one.
        step_s: simulated seconds between two steps.
        planner: adviser of guarded robots; None for `ToGoal`.
        plain: as for `Run`.
        on_start: called once, before the first step.
    Raises: UsageError, Unavailable: the recording cannot be written.
    """
    run = Run(scenario, controller, planner, plain=plain)
    on_start(run)
    with contextlib.ExitStack() as stack:
        check = stack.enter_context(ctrl_c_between_steps())
        recording = None
        if record:
            from .recording import Recording  # noqa: PLC0415 - slow to import

            recording = stack.enter_context(Recording(record, scenario))
        for k in range(math.ceil(scenario.duration_s / step_s - TINY) + 1):
            run.advance(min(k * step_s, scenario.duration_s))
            if recording:
                recording.write(run, run.new_verdicts())
            on_step(run)
            check()
    return run
