"""What kernels and bundles promise: one pointer, the same arrays, and no compiled code that is older than its source."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core import types

from phalanx import kernel as kernel_module
from phalanx.arrays import Records, U8x3
from phalanx.bti.fleet import records
from phalanx.bti.work import make_work
from phalanx.bundle import bundled
from phalanx.config import BtiConfig
from phalanx.sim.audited import loop
from phalanx.sim.audited.events import Queue, make_queue, pack, pop, push
from phalanx.sim.compiling import _called_by
from phalanx.wire.fields import copy, whole

SRC = Path(kernel_module.__file__).parent


def test_a_bundle_shares_its_arrays_with_compiled_code():
    queue = make_queue(4)
    assert push(queue, 5, 7, 8, 9) == 0
    assert queue.tally[0] == 1
    queue.event[0].robot = 80  # written in Python, read in compiled code
    assert pop(queue) == (5, 7, 80, 9)


def test_a_kernel_does_the_same_uncompiled():
    compiled, plain = make_queue(8), make_queue(8)
    for t_us in (5, 3, 9, 3, 1):
        push(compiled, t_us, t_us, 0, 0)
        push.py_func(plain, t_us, t_us, 0, 0)
    assert np.array_equal(compiled.heap, plain.heap)
    assert [pop(compiled) for _ in range(5)] == [pop.py_func(plain) for _ in range(5)]


def test_a_bundle_is_itself_where_nothing_is_compiled(monkeypatch):
    monkeypatch.setattr(kernel_module.numba.config, "DISABLE_JIT", 1)
    queue = Queue(*[np.zeros(1, np.int64)] * len(Queue._fields))
    assert pack(queue) is queue


SEEN = np.dtype([("small", "u1"), ("large", "i8")], align=True)


class Inner(NamedTuple):
    seen: Annotated[Any, Records(SEEN, 2)]
    half: float
    pair: tuple[int, int]


class Outer(NamedTuple):
    inner: Inner
    bytes: U8x3


pack_inner, pack_outer = bundled(Inner), bundled(Outer)


def nested():
    seen = records((3, 2), SEEN)
    return pack_outer(Outer(pack_inner(Inner(seen, 0.5, (3, 4))), np.zeros((2, 3, 4), np.uint8)))


@numba.njit
def touch(outer, i, times):
    total = 0.0
    for _ in range(times):
        record = outer.inner.seen[i, 1]
        record.small += 1
        record.large -= outer.inner.pair[1]
        row = outer.bytes[1, i]
        row[3] += 1
        total += outer.inner.half * len(outer.bytes) + row[3:].size + outer.inner.pair[0]
    return total


def test_fields_are_arrays_of_numbers_and_records_and_numbers_and_tuples_and_bundles():
    outer = nested()
    assert touch(outer, 2, 10) == 10 * (0.5 * 2 + 1 + 3)
    assert outer.inner.seen.tolist() == [[(0, 0), (0, 0)], [(0, 0), (0, 0)], [(0, 0), (10, -40)]]
    assert np.argwhere(outer.bytes).tolist() == [[1, 2, 3]]
    assert outer.bytes[1, 2, 3] == 10


def test_nobody_counts_who_refers_to_what_is_in_a_bundle():
    """Counting takes a third of a simulation's time; a numba that gave these arrays an owner would bring it back."""
    touch(nested(), 0, 1)
    (compiled,) = touch.inspect_llvm().values()
    body = next(each for each in compiled.split("\ndefine ")[1:] if "touch" in each.partition("(")[0]).partition("\n}")[
        0
    ]
    assert "getelementptr" in body
    assert "NRT_" not in body


def test_a_bundle_of_other_arrays_is_another_type():
    wide = pack_inner(Inner(np.zeros((3, 2)), 0.5, (3, 4)))
    assert wide._numba_type_ != nested().inner._numba_type_
    assert nested()._numba_type_ == nested()._numba_type_


def test_an_array_in_another_order_is_no_field():
    with pytest.raises(AssertionError, match="C order"):
        pack_inner(Inner(np.zeros((3, 2)).T, 0.5, (3, 4)))


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


# Two imports away from the loop: loop -> node -> rounds; and the trusted nodes, which C became.
@pytest.mark.parametrize("changed", ["bti/rounds.py", "_firmware_bound.abi3.so"])
def test_compiled_code_is_stale_when_what_it_calls_has_changed(tmp_path, changed):
    copy = tmp_path / "phalanx"
    shutil.copytree(SRC, copy, ignore=shutil.ignore_patterns("__pycache__", "pages", "data"))
    before = stamps_of(tmp_path, "sim/audited/loop.py", "link/pin.py")
    with (copy / changed).open("ab") as file:
        file.write(b"\n# changed\n")
    after = stamps_of(tmp_path, "sim/audited/loop.py", "link/pin.py")
    assert before[0] != after[0]
    assert before[1] == after[1]


def counts(kernel):
    return kernel.targetoptions["_nrt"]


def test_nobody_counts_in_the_loop_but_what_returns_a_view_of_a_bundles_array():
    # An array that a kernel made would never be freed by one that does not count.
    counting = {kernel.__name__ for kernel in _called_by(loop.run) if counts(kernel)}
    assert counting == {"finish", "_finish_ack", "_bytes"}


MAKES = re.compile(
    r"np\.(empty|zeros|ones|full|eye|array|arange)|\.(copy|astype)\(|-> .*(NDArray|Row|[A-Z]+\d*x\d|End)\b"
)


def test_what_makes_arrays_or_returns_them_counts():
    # A maker that another kernel has compiled would not be refused.
    for file in SRC.rglob("*.py"):
        for text in re.findall(r"^@kernel\n(def .*?)(?=\n\n\n|\Z)", file.read_text(), re.MULTILINE | re.DOTALL):
            assert not MAKES.search(text), f"{file}: {text.partition('(')[0]}"


def test_a_kernel_that_does_not_count_makes_no_array_and_keeps_none():
    @kernel_module.kernel
    def borrowing(n: int) -> float:
        made = np.empty(n)
        return made[0]

    with pytest.raises(numba.errors.NumbaError):
        borrowing(3)
    row = np.arange(9, dtype=np.uint8)
    before = sys.getrefcount(row)
    for _ in range(9):
        copy(row, 3, row, 0, 5)
    assert sys.getrefcount(row) == before


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
