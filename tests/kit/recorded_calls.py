"""Record what kernels are called with: `PHALANX_PURE=1 python recorded_calls.py OUT` runs small scenarios and writes a file.

All kernels run as Python here, so that calls from one kernel to another are recorded too. The events of the runs in
run_events.py are written to OUT.events.
"""

from __future__ import annotations

import functools
import pickle
import sys
import time
import warnings
import zlib
from collections import Counter
from pathlib import Path

import numpy as np

import phalanx.kernel as kernel_module

sys.path.insert(0, str(Path(__file__).parents[1]))
# The numbers of the calls that are recorded.
RECORDED = (1, 5, 60)
CASES = [
    # Where half of the packets are lost, a token request is given up.
    ("scenario", {"scenario": "flock-12", "duration_s": 5, "radio": {"loss": 0.5}}),
    ("scenario", {"scenario": "flock-12", "duration_s": 1, "plain": True}),
    ("scenario", {"scenario": "flock-12", "duration_s": 1, "defence": "none", "radio": {"loss": 0.1}}),
    (
        "scenario",
        {"scenario": "flock-12", "duration_s": 3, "controller": "guard", "planner": "examples/guarded.py:Ramming"},
    ),
    ("attack", {"attack": "spoof", "at_s": 0.5, "defence": "paper", "duration_s": 1.5, "scenario": "flock-12"}),
    *[("scenario", {"scenario": each, "duration_s": 1}) for each in ("patrol", "perimeter", "exploration", "tracking")],
    ("demo", {"robots": 12, "duration_s": 4, "attack": "hijack", "at_s": 2.0}),
    ("dotbots", {"robots": 3, "duration_s": 1}),
    (
        "mission",
        {"mission": "office", "profile": "paper", "defence": "none", "robots": 2, "duration_s": 2, "people": 3},
    ),
]
calls: Counter[str] = Counter()
records: dict[str, list[bytes]] = {}


def recorded(function):
    """Return a kernel that keeps copies of the arguments of some of its calls."""
    made = kernel_function(function)
    name = f"{function.__module__}.{function.__name__}"

    @functools.wraps(made)
    def call(*arguments, **named):
        calls[name] += 1
        if calls[name] in RECORDED:
            code = function.__code__
            names = code.co_varnames[: code.co_argcount]
            defaults = dict(zip(names[::-1], (function.__defaults__ or ())[::-1], strict=False))
            given = defaults | dict(zip(names, arguments, strict=False)) | named
            kept = pickle.dumps(tuple(given[each] for each in names), pickle.HIGHEST_PROTOCOL)
            records.setdefault(name, []).append(zlib.compress(kept, 1))
        return made(*arguments, **named)

    return call


class Silence:
    """Takes the events of runs."""

    period_us, fine = 1_000_000, False

    def event(self, *_):
        """Ignore one event."""

    def rows(self, *_):
        """Ignore one sample."""


def go_around() -> None:
    """Walk around things that stand between a robot and its goal, which the missions above leave out."""
    from phalanx.robot.controllers.mission import course

    draw = np.random.default_rng(1)
    for _ in range(2):
        cells = (draw.random(course.SIDE * course.SIDE) < 0.1).astype(np.uint8)
        points, goal = draw.uniform(-1.5, 1.5, (12, 2)), (float(draw.uniform(1, 3)), 0.4)
        course.around(cells, (-course.HALF, -course.HALF), (0.02, -0.03, 0.4), goal, points, len(points))


def main() -> None:
    """Run the scenarios, and write the records."""
    from behaviour.observe import RUNNERS
    from run_events import RUNS, events_of

    warnings.simplefilter("ignore")
    lines: list[str] = []
    for runner, inputs in [*CASES[:-1], *RUNS, CASES[-1]]:
        began = time.process_time()
        if (runner, inputs) in RUNS:
            lines += events_of(runner, inputs)
        else:
            RUNNERS[runner](Silence(), **inputs)
        sys.stderr.write(f"{time.process_time() - began:5.1f} s {len(records)} {runner} {inputs}\n")
    go_around()
    Path(sys.argv[1] + ".events").write_text("\n".join(lines))
    Path(sys.argv[1]).write_bytes(pickle.dumps(records))


kernel_function, kernel_module.kernel = kernel_module.kernel, recorded
if __name__ == "__main__":
    main()
