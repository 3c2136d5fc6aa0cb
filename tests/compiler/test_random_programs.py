"""Random programs of the subset give the same compiled and as plain Python, to the bit."""

from __future__ import annotations

import inspect
import random

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from harness import agree, compiled, kernels_of, load, value_of
from phalanx_compiler.value_types import signature_of
from programs import functions

INPUTS = 12


def compare(seed, folder, programs):
    module = load(functions(seed, programs), folder, "programs")
    kernels = [each for each in kernels_of(module) if each.__name__.startswith("f")]
    made = compiled(kernels, folder, "-O1", "-w")
    draw = random.Random(seed)
    for function in kernels:
        parameters, _ = signature_of(function)
        gave = 0
        for _ in range(INPUTS):
            arguments = [value_of(typ, draw) for typ in parameters.values()]
            try:
                gave += agree(made[function.__name__], function, arguments)
            except Exception as error:
                error.add_note(f"seed {seed}\n{inspect.getsource(function)}")
                raise
        assert gave == INPUTS, inspect.getsource(function)


WITHOUT_SHRINKING = [Phase.explicit, Phase.generate]  # each try runs gcc
SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]


@settings(max_examples=2, phases=WITHOUT_SHRINKING, suppress_health_check=SLOW)
@given(st.integers(0, 2**40))
def test_random_programs_do_the_same_compiled(tmp_path, seed):
    compare(seed, tmp_path, 30)


@pytest.mark.long
@settings(max_examples=40, phases=WITHOUT_SHRINKING, suppress_health_check=SLOW)
@given(st.integers(0, 2**40))
def test_many_random_programs_do_the_same_compiled(tmp_path, seed):
    compare(seed, tmp_path, 60)
