"""A scenario from its beginning to its end, watched and recorded on the way."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from pathlib import Path

from .recording import Recording
from .run import Run
from .scenario import Scenario

# As often as the robots act.
STEP_S = 0.25


def play(scenario: Scenario, record: Path | None = None, on_step: Callable[[Run], None] = lambda _run: None) -> Run:
    """The run, at the end of the scenario.

    Args:
        scenario: what runs.
        record: MCAP file to write, or None.
        on_step: called at each quarter of a simulated second; whatever it raises ends the run, the recording complete.
    Raises: UsageError, Unavailable: the recording cannot be written.
    Source: none.
    """
    run = Run(scenario)
    with contextlib.ExitStack() as stack:
        recording = stack.enter_context(Recording(record, scenario)) if record else None
        for k in range(math.ceil(scenario.duration_s / STEP_S) + 1):
            run.advance(min(k * STEP_S, scenario.duration_s))
            if recording:
                recording.write(run, run.new_verdicts())
            on_step(run)
    return run
