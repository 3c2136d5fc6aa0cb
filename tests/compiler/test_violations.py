"""A violated check raises with file and line, the process goes on, and nothing leaks."""

from __future__ import annotations

import inspect
import logging
import random
import threading
from pathlib import Path

import numpy as np
import pytest

import violations
from harness import agree, compiled, kernels_of, value_of
from phalanx.errors import KernelDefect
from phalanx_compiler.value_types import signature_of

KERNELS = {each.__name__: each for each in kernels_of(violations)}
WORDS = {
    "index": r"index -?\d+ is outside an array of \d+",
    "shape": r"an array of length \d+, expected \d+",
    "size": r"an array cannot have length -?\d+; the largest is \d+",
    "divisor": "a division by zero",
    "number": "NaN, infinite, or beyond 64 bits: no int can hold it",
    "scratch": r"scratch memory: \d+ bytes where \d+ are allowed",
    "result": "the kernel ends without a return",
}
MARKED = [
    (name, offset, mark)
    for name, function in KERNELS.items()
    for offset, line in enumerate(inspect.getsource(function).split("\n"))
    for mark in WORDS
    if line.endswith(f"  # {mark}")
]
FAR = [-1, 10**6, -(2**63), 2**63 - 1]
NO_WHOLE = [float("nan"), float("inf"), float("-inf"), 9.3e18, -9.3e18, -9.25e18]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return compiled(list(KERNELS.values()), tmp_path_factory.mktemp("violations"))


def arguments_of(name, far, whole):
    draw = random.Random(name)
    parameters, _ = signature_of(KERNELS[name])
    set_to = {"i": far, "zero": 0, "x": whole}
    return [set_to[each] if each in set_to else value_of(typ, draw) for each, typ in parameters.items()]


@pytest.mark.parametrize(("name", "offset", "mark"), MARKED, ids=[each[0] for each in MARKED])
def test_it_raises_with_its_file_and_line(made, name, offset, mark):
    line = inspect.getsourcelines(KERNELS[name])[1] + offset
    for far in FAR if name != "too_much_in_a_loop" else FAR[:1]:
        for whole in NO_WHOLE if mark == "number" else [0.0]:
            arguments = arguments_of(name, far, whole)
            with pytest.raises(KernelDefect, match=rf"violations\.py:{line}: {WORDS[mark]}"):
                made[name](*arguments)


def test_each_form_has_a_kernel():
    assert {mark for *_, mark in MARKED} == set(WORDS)
    assert len(MARKED) == len(KERNELS) - 4  # those that call others


def test_the_same_kernels_go_on_with_what_is_inside(made):
    a = np.arange(6)
    for _ in range(3):
        with pytest.raises(KernelDefect):
            made["element"](a, 6)
        assert made["element"](a, 5) == 5
        with pytest.raises(KernelDefect):
            made["element_augmented"](a, -1)
    assert a.tolist() == list(range(6))


def test_what_was_stored_before_stays(made):
    a = np.arange(6)
    with pytest.raises(KernelDefect):
        made["swapped"](a, 7)
    assert a.tolist() == list(range(6))
    assert agree(made["swapped"], KERNELS["swapped"], [a, 3])


def test_calls_inside_calls_unwind_to_python(made):
    a = np.arange(6)
    with pytest.raises(KernelDefect, match=r"violations\.py:\d+: index 9"):
        made["deep"](a, 9)
    assert made["deep"](a, 2) == 2


def test_a_guarded_kernel_gives_its_own_result_and_is_logged(made, caplog, kernel_defects):
    a = np.arange(6)
    with caplog.at_level(logging.ERROR):
        assert made["after_reading"](a, 3) == 302
        assert not caplog.messages
        assert made["after_reading"](a, 77) == -298
    (line,) = caplog.messages
    assert "violations.py" in line
    assert "the peer's message was rejected" in line
    with caplog.at_level(logging.ERROR), pytest.raises(KernelDefect):
        made["twice"](a, 77)
    assert len(kernel_defects) == 2  # although the second call raised as well
    kernel_defects.clear()


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.parametrize("name", ["element", "deep", "after_reading", "whole_of_nan", "records"])
def test_ten_thousand_violations_leak_nothing(made, name):
    logging.getLogger("phalanx.kernel").disabled = True
    try:
        call = made[name if name != "records" else "record_stored"]
        arguments = arguments_of(name if name != "records" else "record_stored", 99, float("nan"))

        def run(times):
            for _ in range(times):
                try:
                    call(*arguments)
                except KernelDefect:
                    continue

        run(2000)
        before = resident_bytes()
        run(10_000)
        assert resident_bytes() - before < 2 << 20
    finally:
        logging.getLogger("phalanx.kernel").disabled = False


def test_scratch_memory_that_was_exhausted_is_released(made):
    for _ in range(3):
        with pytest.raises(KernelDefect):
            made["too_much_in_a_loop"](1)
    before = resident_bytes()
    for _ in range(5):
        with pytest.raises(KernelDefect):
            made["too_much_in_a_loop"](1)
    assert resident_bytes() - before < 8 << 20


def test_threads_violate_beside_each_other(made):
    a, wrong = np.arange(6), []

    def run(number):
        for k in range(1500):
            try:
                value = made["deep"](a, k % 9)
                if value != k % 9:
                    wrong.append((number, k, value))
            except KernelDefect as error:
                if k % 9 < 6 or f"index {k % 9} " not in str(error):
                    wrong.append((number, k, str(error)))

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert wrong == []


def test_a_kernel_refuses_other_arguments(made):
    a = np.arange(6)
    call = made["element"]
    for given, words in [
        ((a.astype(np.int32), 1), "an array of dtype"),
        ((a.reshape(2, 3), 1), "an array with 1 axes is expected"),
        ((a[::2], 1), "an array in C order"),
        (([1, 2], 1), "an array is expected"),
        ((a, 1.5), "a whole number is expected"),
        ((a,), "argument i is missing"),
        ((a, 1, 2), "takes 2 arguments"),
    ]:
        with pytest.raises(TypeError, match=words):
            call(*given)
    with pytest.raises(OverflowError):
        call(a, 2**63)
    with pytest.raises(TypeError):
        call(a, 1, j=3)
    assert call(i=2, a=a) == 2


def test_read_only_arrays_are_refused_where_they_are_written_to(made):
    a = np.arange(6)
    a.flags.writeable = False
    assert made["element"](a, 2) == 2
    with pytest.raises(ValueError, match="read-only"):
        made["element_stored"](a, 2)
