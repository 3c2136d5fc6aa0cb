"""Nothing is called for the first time while robots live: it would be compiled at their priority, and convict them."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.waits, pytest.mark.timeout(300)]

# Lives in the arena's process and in those forked from it: each writes down which kernels got code after it began.
WATCH = """
import gc, json, os, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from phalanx.cli.main import run_command
from phalanx.daemon import arena, life

FOLDER, began, known = Path(sys.argv[1]), {}, []

def ready():
    return {f"{each.py_func.__module__}.{each.__name__}": len(each.overloads) for each in known}

def find():
    gc.unfreeze()
    known[:] = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]

def look():
    find()
    began.update(ready())

def write(name):
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # who looks long takes nobody's turn
    find()
    late = {key: n for key, n in ready().items() if n > began.get(key, 0)}
    (FOLDER / f"{name}.late").write_text(json.dumps(late))

def after(whose, name, note):
    true = getattr(whose, name)
    def noting(self, *more):
        done = true(self, *more)
        note()
        return done
    setattr(whose, name, noting)

def before(whose, name, note):
    true = getattr(whose, name)
    def noting(self, *more):
        note(self)
        return true(self, *more)
    setattr(whose, name, noting)

after(life.Life, "begin", lambda: began.update(ready()))
before(life.Life, "close", lambda robot: write(robot.id) if began else None)
after(arena.Arena, "__init__", look)
before(arena.Arena, "close", lambda _: write(f"arena-{os.getpid()}"))
sys.exit(run_command(sys.argv[2:]))
"""
GUARDED = """controller: guard
robots: 3
grid_step_m: 4
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500}
"""
DRIVEN = """controller: wheels
robots: 3
grid_step_m: 0.6
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 200, steps_per_state: 2, delta_ms: 95, skew_ms: 200}
"""


@pytest.mark.parametrize(
    ("mission", "more"),
    [
        ("flock-12", ("--robots", "3", "--attack", "hijack:robot=3,at=2", "--loss", "0.2", "--repeats", "0.1")),
        ("flock-12", ("--robots", "3", "--sealed", "--cut", "1", "--cut-at", "2")),
        (GUARDED, ()),
        (DRIVEN, ()),
    ],
    ids=["a liar", "sealed, cut", "guard", "wheels"],
)
def test_all_that_robots_and_their_arena_run_has_run_before_they_live(tmp_path, mission, more):
    if "\n" in mission:
        (tmp_path / "mission.yaml").write_text(mission)
        mission = str(tmp_path / "mission.yaml")
    words = ("robot", "arena", mission, "--f-max", "1", "--duration", "6", "--json", *more)
    done = subprocess.run(
        (sys.executable, "-c", WATCH, str(tmp_path), *words),
        env=os.environ,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    late = {path.stem: json.loads(path.read_text()) for path in tmp_path.glob("*.late")}
    assert {"1", "2", "3"} < late.keys(), late
    assert sum(name.startswith("arena") for name in late) >= 1
    assert not any(late.values()), late
