"""Calls of compiled kernels, and bundles: the same bytes as uncompiled, no wrong argument, no stale binary."""

from __future__ import annotations

import inspect
import json
import os
import pickle
import shutil
import subprocess
import sys
import threading
import time
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

import phalanx_compiler
from phalanx import kernel as kernel_module
from phalanx.arrays import Records, U8x3
from phalanx.binary import HINT
from phalanx.bti import trusted
from phalanx.bti.fleet import records
from phalanx.bti.work import make_work
from phalanx.bundle import bundled
from phalanx.config import BtiConfig
from phalanx.errors import KernelDefect
from phalanx.mission.pose.spread import Sight, place_deviations
from phalanx.pool import make_pool
from phalanx.wire import fields
from phalanx.world.audited.events import Queue, make_queue, pack, pop, push, refused
from phalanx_compiler.value_types import fields_of

SRC = Path(kernel_module.__file__).parent


def test_a_kernel_does_the_same_uncompiled():
    compiled, plain = make_queue(8), make_queue(8)
    for t_us in (5, 3, 9, 3, 1):
        push(compiled, t_us, t_us, 0, 0)
        push.py_func(plain, t_us, t_us, 0, 0)
    assert np.array_equal(compiled.heap, plain.heap)
    assert [pop(compiled) for _ in range(5)] == [pop.py_func(plain) for _ in range(5)]


def test_a_kernel_has_the_name_the_documentation_and_the_signature_of_its_function():
    assert type(push).__name__ == "Kernel"
    assert push.__wrapped__ is push.py_func
    assert (push.__name__, push.__module__) == ("push", "phalanx.world.audited.events")
    assert push.__doc__ == push.py_func.__doc__
    assert [*inspect.signature(push).parameters] == ["queue", "t_us", "kind", "robot", "arg"]


# --- arguments --------------------------------------------------------------------------------------------------------


def test_arguments_are_given_by_place_or_by_name():
    queue = make_queue(4)
    push(queue, 5, robot=8, kind=7, arg=9)
    push(arg=4, robot=3, kind=2, t_us=1, queue=queue)
    assert [pop(queue), pop(queue)] == [(1, 2, 3, 4), (5, 7, 8, 9)]


@pytest.mark.parametrize(
    ("given", "named", "why"),
    [
        ((1, 2, 3), {}, "argument arg is missing"),
        ((1, 2), {"arg": 4}, "argument robot is missing"),
        ((1, 2, 3, 4, 5), {}, "takes 5 arguments"),
        ((1, 2, 3, 4), {"arg": 4}, "takes 5 arguments"),
        ((1, 2, 3), {"place": 4}, "argument arg is missing"),
        ((1, 2, 3), {"t_us": 4}, "argument arg is missing"),
    ],
)
def test_an_argument_that_is_missing_unknown_or_given_twice_is_refused(given, named, why):
    queue = make_queue(4)
    with pytest.raises(TypeError, match=rf"phalanx\.world\.audited\.events\.push.*{why}"):
        push(queue, *given, **named)
    assert queue.tally[0] == 0


@pytest.mark.parametrize("wrong", [1.0, np.float64(1.0), "1", None, b"1", (1,), np.arange(2)])
def test_what_is_no_whole_number_is_refused_where_one_belongs(wrong):
    with pytest.raises(TypeError):
        fields.get_f32(np.zeros(8, np.uint8), wrong)


def test_whole_numbers_of_numpy_are_whole_numbers():
    row = np.arange(8, dtype=np.uint8)
    for kind in (np.int64, np.int32, np.uint8, np.uint64):
        assert fields.get_i8(row, kind(2)) == 2


def test_a_number_that_64_bits_do_not_hold_is_refused():
    with pytest.raises(OverflowError):
        fields.get_f32(np.zeros(8, np.uint8), 1 << 63)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (np.zeros(8, np.int8), "dtype.*uint8.*is expected, not.*int8"),
        (np.zeros(8), "float64"),
        (np.zeros(8, ">u2"), "uint16|>u2"),
        (np.zeros((2, 4), np.uint8), "1 axes is expected, not 2"),
        (np.zeros((), np.uint8), "1 axes is expected, not 0"),
        (np.zeros(16, np.uint8)[::2], "C order"),
        (np.zeros(8, np.uint8)[::-1], "C order"),
        (bytes(8), "an array is expected"),
        ([0] * 8, "an array is expected"),
        (None, "an array is expected"),
    ],
    ids=lambda wrong: "" if isinstance(wrong, str) else repr(wrong)[:30],
)
def test_an_array_of_another_dtype_or_number_of_axes_or_order_is_refused(wrong, why):
    with pytest.raises(TypeError, match=why):
        fields.get_f32(wrong, 0)


@pytest.mark.parametrize("wrong", [(0.1, 0.2), (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7), [0.1, 0.2, 0.3], 0.1])
def test_a_tuple_of_another_length_is_refused(wrong):
    spread = np.zeros((3, 3))
    with pytest.raises(TypeError, match="a tuple of"):
        place_deviations(spread, 1.0, 2.0, wrong)
    assert place_deviations(spread, 1.0, 2.0, Sight(0.1, 0.2, 0.3)) == place_deviations(
        spread, 1.0, 2.0, (0.1, 0.2, 0.3)
    )


def test_read_only_arrays_are_refused_where_the_kernel_writes_and_only_there():
    mine, fixed = np.zeros(8, np.uint8), np.arange(8, dtype=np.uint8)
    fixed.flags.writeable = False
    assert fields.get_i8(fixed, 1) == 1
    fields.copy(mine, 0, fixed, 1, 4)
    assert mine.tolist() == [1, 2, 3, 4, 0, 0, 0, 0]
    for writes in (lambda: fields.copy(fixed, 0, mine, 0, 4), lambda: fields.put_f32(fixed, 0, 7.0)):
        with pytest.raises(ValueError, match="read-only"):
            writes()
    assert fixed.tolist() == [*range(8)]


@pytest.mark.parametrize("name", Queue._fields)
def test_a_bundle_with_a_read_only_array_is_refused_where_the_kernel_writes_to_it_and_only_there(name):
    queue = make_queue(4)
    push(queue, 5, 7, 8, 9)
    arrays = {each: getattr(queue, each).copy() for each in Queue._fields}
    arrays[name].flags.writeable = False
    fixed = pack(Queue(**arrays))
    assert refused(fixed) == 0
    for writes in (lambda: pop(fixed), lambda: push(fixed, 1, 2, 3, 4)):
        with pytest.raises(ValueError, match=rf"Queue\.{name} is read-only, and the kernel writes to its bundle"):
            writes()
    assert all((getattr(fixed, each) == getattr(queue, each)).all() for each in arrays)


def test_a_bundle_that_holds_one_with_a_read_only_array_is_refused_too():
    inner = an_inner()
    inner.seen.flags.writeable = False
    outer = pack_outer(Outer(pack_inner(inner), np.zeros((2, 3, 4), np.uint8), 7))
    assert (outer._kept[0], outer._read_only) == (1, "Inner.seen")


def test_neither_a_call_nor_one_that_fails_keeps_its_arguments():
    row, queue = np.arange(9, dtype=np.uint8), make_queue(4)
    before = sys.getrefcount(row), sys.getrefcount(queue)
    for _ in range(9):
        fields.copy(row, 3, row, 0, 5)
        push(queue, 1, 2, 3, 4)
        for fails in (lambda: fields.copy(row, 9, row, 0, 5), lambda: push(queue, 1, 2, 3, row)):
            with pytest.raises((KernelDefect, TypeError)):
                fails()
    assert (sys.getrefcount(row), sys.getrefcount(queue)) == before


# --- bundles ----------------------------------------------------------------------------------------------------------


def test_a_bundle_shares_its_arrays_with_compiled_code():
    queue = make_queue(4)
    assert push(queue, 5, 7, 8, 9) == 0
    assert queue.tally[0] == 1
    queue.event[0].robot = 80  # written in Python, read in compiled code
    assert pop(queue) == (5, 7, 80, 9)


def test_a_bundle_is_itself_where_nothing_is_compiled(monkeypatch):
    monkeypatch.setattr("phalanx.bundle.PURE", True)
    queue = Queue(*[np.zeros(1, np.int64)] * len(Queue._fields))
    assert pack(queue) is queue


def test_a_bundle_of_another_class_is_refused():
    with pytest.raises(TypeError, match=r"events\.Queue.*is expected, not .*Pool"):
        push(make_pool(3, 8), 1, 2, 3, 4)
    with pytest.raises(TypeError, match=r"events\.Queue.*is expected, not None"):
        push(None, 1, 2, 3, 4)


def test_which_arrays_a_bundle_has_never_changes():
    queue = make_queue(4)
    with pytest.raises(AttributeError, match=r"Queue\.heap"):
        queue.heap = np.zeros(4, np.int32)


def test_a_bundle_that_was_pickled_or_copied_has_arrays_of_its_own():
    queue = make_queue(4)
    push(queue, 5, 7, 8, 9)
    for other in (pickle.loads(pickle.dumps(queue)), deepcopy(queue)):
        assert pop(other) == (5, 7, 8, 9)
        push(other, 1, 2, 3, 4)
    assert queue.tally[0] == 1
    assert pop(queue) == (5, 7, 8, 9)


SEEN = np.dtype([("small", "u1"), ("large", "i8")], align=True)


class Inner(NamedTuple):
    seen: Annotated[Any, Records(SEEN, 2)]
    half: float
    pair: tuple[int, float]


class Outer(NamedTuple):
    inner: Inner
    bytes: U8x3
    count: int


pack_inner, pack_outer = bundled(Inner), bundled(Outer)


def an_inner(**other):
    return Inner(**{"seen": records((3, 2), SEEN), "half": 0.5, "pair": (3, 4.0)} | other)


def test_fields_are_arrays_of_numbers_and_records_and_numbers_and_tuples_and_bundles():
    inner = pack_inner(an_inner())
    outer = pack_outer(Outer(inner, np.zeros((2, 3, 4), np.uint8), 7))
    of_inner, of_outer = inner._kept[1:], outer._kept[1:]  # a word behind their addresses
    assert (of_inner.ctypes.data, of_outer.ctypes.data) == (inner._address, outer._address)
    assert of_outer.tolist() == [inner._address, outer.bytes.ctypes.data, 2, 3, 4, 7]
    assert of_inner.tolist()[:3] == [inner.seen.ctypes.data, 3, 2]
    assert of_inner.view(np.float64)[[3, 5]].tolist() == [0.5, 4.0]
    assert of_inner[4] == 3
    assert [str(typ) for _, typ in fields_of(Outer)] == ["Inner", "array of uint8 with 3 axes", "int"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"seen": np.zeros((3, 2))},
        {"seen": np.zeros((3, 2), np.dtype([("small", "u1"), ("large", "i4")], align=True))},
        {"seen": records((2, 3), SEEN).T},
        {"seen": records((3, 4), SEEN)[:, ::2]},
        {"seen": records(6, SEEN)},
        {"seen": records((3, 2), SEEN).tolist()},
        {"half": 1},
        {"pair": (3, 4)},
        {"pair": (3.0, 4.0)},
        {"pair": (3, 4.0, 5)},
        {"pair": 3},
    ],
    ids=lambda wrong: repr(wrong)[:50],
)
def test_what_a_field_is_not_declared_as_is_refused(wrong):
    with pytest.raises(TypeError, match=rf"Inner\.{next(iter(wrong))}"):
        pack_inner(an_inner(**wrong))


def test_a_bundle_in_a_bundle_has_the_class_that_is_declared():
    for wrong in (an_inner(), make_queue(4), None):
        with pytest.raises(TypeError, match=r"Outer\.inner"):
            pack_outer(Outer(wrong, np.zeros((2, 3, 4), np.uint8), 7))


def test_scratch_memory_holds_the_longest_batch_of_entries():
    work = make_work(BtiConfig())
    assert work.batch.shape == (2, 10 * (7 + 2048))


# --- violated checks, threads -----------------------------------------------------------------------------------------


def test_an_index_that_is_outside_is_an_error_that_names_its_line_and_the_process_goes_on():
    row = np.arange(8, dtype=np.uint8)
    lines, first = inspect.getsourcelines(fields.get_f32.py_func)
    for at in (5, 8, 1 << 40, -1, -(1 << 63)):
        with pytest.raises(KernelDefect, match=r"index -?\d+ is outside an array of 8") as defect:
            fields.get_f32(row, at)
        file, line = str(defect.value).split(": ")[0].rsplit(":", 1)
        assert file.endswith("wire/fields.py")
        assert first <= int(line) < first + len(lines)
        assert defect.value.hint
        assert fields.get_f32(row, 4) == np.frombuffer(bytes([4, 5, 6, 7]), "<f4")[0]


LONG = np.zeros(1 << 26, np.uint8)


def hashed() -> tuple[bytes, float]:
    """Return the digest of 64 MB, and how long it took."""
    began, out = time.perf_counter(), np.zeros(20, np.uint8)
    trusted.sha1(LONG, LONG.size, out)
    return out.tobytes(), time.perf_counter() - began


def test_other_threads_run_while_a_kernel_runs():
    took, looked = [], []
    thread = threading.Thread(target=lambda: took.append(hashed()[1]))
    thread.start()
    while thread.is_alive():
        looked.append(time.perf_counter())
        time.sleep(0.001)
    thread.join()
    # One that held the interpreter's lock would let nobody look but at its beginning and its end.
    inside = [t for t in looked if looked[0] + 0.2 * took[0] < t < looked[0] + 0.8 * took[0]]
    assert len(inside) >= 3


def test_threads_have_violations_of_their_own():
    right, seen = hashed()[0], []

    def violate():
        for _ in range(200):
            with pytest.raises(KernelDefect):
                fields.get_f32(LONG, LONG.size)
        seen.append(True)

    threads = [threading.Thread(target=violate), threading.Thread(target=lambda: seen.append(hashed()[0] == right))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == [True, True]


# --- the binary, and the sources beside it ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """The package and its compiler in a folder of their own."""
    root = tmp_path_factory.mktemp("copied")
    # With its bytecode: to compile all modules takes longer than a command.
    ignore = shutil.ignore_patterns("pages", "data")
    for name, source in {"phalanx": SRC, "phalanx_compiler": Path(phalanx_compiler.__file__).parent}.items():
        shutil.copytree(source, root / name, ignore=ignore)
    return root


def run(root, *words, **env):
    env = {"PYTHONPATH": str(root), "PATH": os.environ["PATH"]} | env
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, env=env, check=False, cwd=root)


PUSHED = """
from phalanx.world.audited.events import make_queue, pop, push
queue = make_queue(4)
push(queue, 5, 7, 8, 9)
print(type(push).__name__, *pop(queue))
"""


# An editable install finds its own binary where the copy has none.
COMMAND = """
import sys
sys.meta_path[:] = [each for each in sys.meta_path if "Editable" not in str(each)]
from phalanx.cli.main import run_command
sys.exit(run_command(sys.argv[1:]))
"""


ONE_FINDING = """
import dataclasses, json, sys
sys.meta_path[:] = [each for each in sys.meta_path if "Editable" not in str(each)]
from phalanx.cli import doctor
print(json.dumps(dataclasses.asdict(getattr(doctor, sys.argv[1])())))
"""


def refused_at_start(root):
    """Return the error of a command that needs kernels, one line of stderr beside its hint."""
    done = run(root, "-c", COMMAND, "sim", "run", "flock-12", "--duration", "1")
    assert done.returncode == 1
    assert done.stdout == ""
    error, hint = done.stderr.splitlines()
    assert hint == f"phalanx: hint: {HINT}"
    return error


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("phalanx/wire/fields.py", "# changed"),
        ("phalanx/wire/fields.py", None),
        ("phalanx/robot/controllers/bundled/flock.py", "# changed"),
        ("phalanx_compiler/runtime.h", "/* changed */"),
    ],
)
def test_kernels_that_were_compiled_from_other_sources_are_refused_in_a_line(copied, file, changed):
    path = copied / file
    before = path.read_bytes()
    try:
        if changed:
            path.write_bytes(before + f"\n{changed}\n".encode())
        else:
            path.unlink()
        assert file in refused_at_start(copied)
        if changed:  # uncompiled it runs
            done = run(copied, "-c", PUSHED, PHALANX_PURE="1")
            assert done.stdout == "function 5 7 8 9\n", done.stderr
    finally:
        path.write_bytes(before)
    assert run(copied, "-c", PUSHED).stdout == "Kernel 5 7 8 9\n"


def test_without_a_binary_the_error_is_a_line_too(copied):
    (binary,) = (copied / "phalanx").glob("_kernels*.so")
    away = binary.rename(copied / "away")
    try:
        assert "the kernels are not compiled" in refused_at_start(copied)
        assert run(copied, "-c", PUSHED, PHALANX_PURE="1").stdout == "function 5 7 8 9\n"
    finally:
        away.rename(binary)


def found_by_doctor(root, *words, **env):
    """Return what the doctor finds, by its name."""
    done = run(root, "-c", COMMAND, "doctor", "--json", *words, **env)
    assert done.stderr == ""
    findings = {each["what"]: each for each in json.loads(done.stdout)["findings"]}
    assert done.returncode == (0 if all(each["ok"] for each in findings.values()) else 1)
    return findings


def one_found(root, name, **env):
    """Return one of the doctor's findings, without the second that the others take."""
    return json.loads(run(root, "-c", ONE_FINDING, name, **env).stdout)


def test_the_doctor_names_kernels_and_trusted_nodes_in_every_state(copied, tmp_path):
    def kernels(**env):
        found = one_found(copied, "_kernels", **env)
        return found["ok"], found["found"], found["fix"]

    assert kernels() == (True, "compiled, up to date", "")
    assert kernels(PHALANX_PURE="1") == (True, "uncompiled and slow, as PHALANX_PURE is set", "unset PHALANX_PURE")
    source = copied / "phalanx" / "wire" / "fields.py"
    before = source.read_bytes()
    source.write_bytes(before + b"# changed\n")
    try:
        stale = (False, "the kernels were compiled before phalanx/wire/fields.py changed", HINT)
        assert kernels() == stale
        # The modules of all other findings would end here.
        assert found_by_doctor(copied, "--broker", "mqtt://127.0.0.1:1")["kernels"]["found"] == stale[1]
    finally:
        source.write_bytes(before)
    (binary,) = (copied / "phalanx").glob("_kernels*.so")
    away = binary.rename(tmp_path / "away")
    try:
        assert kernels() == (False, "the kernels are not compiled", HINT)
        binary.write_bytes(b"no library")
        assert kernels()[1].startswith("the compiled kernels cannot be loaded: ")
    finally:
        away.replace(binary)
    (nodes,) = (copied / "phalanx").glob("_firmware_paper*.so")
    away = nodes.rename(tmp_path / "away")
    try:
        found = found_by_doctor(copied)
        assert (found["kernels"]["ok"], found["trusted nodes"]["ok"]) == (True, False)
        assert found["trusted nodes"]["found"] == "not compiled: _firmware_paper"
    finally:
        away.rename(nodes)


def test_kernels_that_were_compiled_for_nodes_of_another_size_are_refused(copied, tmp_path):
    load = ("-c", "from phalanx import binary; binary.load_binary()")
    assert run(copied, *load).returncode == 0
    (nodes,) = (copied / "phalanx").glob("_firmware_hardened*.so")
    away, other = nodes.rename(tmp_path / "away"), copied / "phalanx" / "_firmware_hardened.py"
    other.write_text("class lib:\n    phx_snode_size = phx_anode_size = staticmethod(lambda: 1)\n")
    try:
        done = run(copied, *load)
        assert done.returncode == 1
        assert done.stderr.endswith("Unavailable: the kernels were compiled for trusted nodes of another size\n")
    finally:
        other.unlink()
        away.rename(nodes)


def test_the_doctor_names_the_c_compiler_for_ones_own_controllers(copied, tmp_path):
    compiler = tmp_path / "my-cc"
    compiler.write_text("#!/bin/sh\n")
    compiler.chmod(0o755)
    asked = ({"CC": "nowhere"}, "CC=nowhere: command not found"), ({"PATH": ""}, "there is no C compiler")
    found = found_by_doctor(copied, CC=str(compiler))["C compiler"]
    assert (found["ok"], found["found"]) == (True, str(compiler))
    for env, why in asked:
        found = one_found(copied, "_c_compiler", **env)
        assert found["found"] == f"{why}: your own controllers run uncompiled"
        assert found["fix"]


def test_a_kernel_that_the_binary_lacks_is_refused(copied):
    more = copied / "phalanx" / "wire" / "more.py"
    more.write_text("from phalanx.kernel import kernel\n\n@kernel\ndef twice(n: int) -> int:\n    return 2 * n\n")
    try:
        done = run(copied, "-c", "import phalanx.wire.more")
        assert done.stderr.splitlines()[-1].endswith("the compiled kernels have no phalanx.wire.more.twice")
        done = run(copied, "-c", "from phalanx.wire.more import twice; print(twice(4))", PHALANX_PURE="1")
        assert done.stdout == "8\n", done.stderr
    finally:
        more.unlink()


def test_a_kernel_of_somebody_else_runs_as_it_is():
    @kernel_module.kernel
    def twice(n: int) -> int:
        return 2 * n

    assert inspect.isfunction(twice)
    assert twice(4) == 8
