"""A scenario from its beginning to its end, watched and recorded on the way."""

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

# As often as the robots act.
STEP_S = 0.25
# Told at once, and by no file object: a signal may come in the middle of its writing.
STOPPING = b"\nphalanx: stopping after this step; Ctrl-C again ends it at once\n"
TINY = 1e-9  # a step is not followed by one of nothing because 0.3 / 0.1 is more than 3


@contextlib.contextmanager
def ctrl_c_between_steps() -> Iterator[Callable[[], None]]:
    """Ctrl-C and SIGTERM wait for the function given, which then raises KeyboardInterrupt; a second comes at once.

    So a step is recorded whole. Outside the main thread, which alone receives signals, nothing changes.
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


def play(
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
    """The run, at the end of the scenario.

    Args:
        record: MCAP file to write, or None.
        on_step: called each `step_s` from 0 on, and at the end; what it raises ends the run, the recording complete.
        controller: a researcher's own, made for each robot's id; None for the scenario's bundled one.
        step_s: between two steps, simulated seconds.
        planner: who advises robots that a guard drives; None for `ToGoal`.
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
            from .recording import Recording  # noqa: PLC0415 - its formats take as long to load as a small swarm to run

            recording = stack.enter_context(Recording(record, scenario))
        for k in range(math.ceil(scenario.duration_s / step_s - TINY) + 1):
            run.advance(min(k * step_s, scenario.duration_s))
            if recording:
                recording.write(run, run.new_verdicts())
            on_step(run)
            check()
    return run
