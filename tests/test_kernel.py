"""What kernels and bundles promise: one pointer, the same arrays, and no compiled code that is older than its source."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from numba.core import types

from phalanx import kernel as kernel_module
from phalanx.bti.audit import make_work
from phalanx.config import BtiConfig
from phalanx.sim.audited.events import Queue, make_queue, pack, pop, push
from phalanx.wire.fields import whole

SRC = Path(kernel_module.__file__).parent


def test_a_bundle_shares_its_arrays_with_compiled_code():
    queue = make_queue(4)
    assert push(queue, 5, 7, 8, 9) == 0
    assert queue.tally[0] == 1
    queue.data[0, 1] = 80  # written in Python, read in compiled code
    assert pop(queue) == (5, 7, 80, 9)


def test_a_kernel_does_the_same_uncompiled():
    compiled, plain = make_queue(8), make_queue(8)
    for t_us in (5, 3, 9, 3, 1):
        push(compiled, t_us, t_us, 0, 0)
        push.py_func(plain, t_us, t_us, 0, 0)
    assert np.array_equal(compiled.keys, plain.keys)
    assert [pop(compiled) for _ in range(5)] == [pop.py_func(plain) for _ in range(5)]


def test_a_bundle_is_itself_where_nothing_is_compiled(monkeypatch):
    monkeypatch.setattr(kernel_module.numba.config, "DISABLE_JIT", 1)
    queue = Queue(np.zeros((1, 2), np.int64), np.zeros((1, 3), np.int64), np.zeros(3, np.int64))
    assert pack(queue) is queue


def test_scratch_memory_holds_the_longest_batch_of_entries():
    work = make_work(BtiConfig())
    assert work.batch.shape == (2, 10 * (7 + 2048))


def test_whoever_calls_with_a_constant_or_a_narrow_number_gets_the_kernel_of_every_number():
    before = set(whole.signatures)
    for kind in (types.literal(3), types.literal(4), types.int32, types.int64):
        whole.get_call_template((kind,), {})
    assert set(whole.signatures) - before <= {(types.int64,)}


def stamps_of(root: Path, *modules: str) -> list[str]:
    code = f"from phalanx import kernel; print(*(kernel._stamp(kernel._ROOT / each) for each in {modules}))"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONPATH": str(root)}
    )
    return run.stdout.split()


def test_compiled_code_is_stale_when_what_it_calls_has_changed(tmp_path):
    copy = tmp_path / "phalanx"
    shutil.copytree(SRC, copy, ignore=shutil.ignore_patterns("__pycache__", "pages", "data"))
    before = stamps_of(tmp_path, "sim/audited/loop.py", "link/pin.py")
    # Two imports away from the loop: loop -> node -> rounds.
    rounds = copy / "bti" / "rounds.py"
    rounds.write_text(rounds.read_text() + "\n# changed\n")
    after = stamps_of(tmp_path, "sim/audited/loop.py", "link/pin.py")
    assert before[0] != after[0]
    assert before[1] == after[1]


ONE_OF_TWO = """
import sys
from phalanx.mission.angles import sin_cos
sin_cos({})
print("made" if sin_cos.stats.cache_misses else "found")
"""


def test_processes_that_need_a_kernel_at_once_compile_it_once_and_keep_what_each_made(tmp_path):
    env = os.environ | {"PYTHONPATH": str(SRC.parent), "NUMBA_CACHE_DIR": str(tmp_path)}

    def at_once(*numbers: str) -> list[str]:
        running = [
            subprocess.Popen([sys.executable, "-c", ONE_OF_TWO.format(x)], stdout=subprocess.PIPE, text=True, env=env)
            for x in numbers
        ]
        return sorted(one.communicate()[0].strip() for one in running)

    assert at_once("0.5", "0.5", "1") == ["found", "made", "made"]
    assert at_once("0.5", "1") == ["found", "found"]
