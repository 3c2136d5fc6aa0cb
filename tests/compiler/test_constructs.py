"""Every construct of the subset gives the same compiled and as plain Python, to the bit."""

from __future__ import annotations

import random

import numpy as np
import pytest

import constructs
from harness import agree, bits, compiled, kernels_of, value_of
from phalanx_compiler.value_types import Array, Record, signature_of

KERNELS = {each.__name__: each for each in kernels_of(constructs)}
RANDOM = 150


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return compiled(list(KERNELS.values()), tmp_path_factory.mktemp("constructs"))


def inputs_of(name: str) -> list[list[object]]:
    draw = random.Random(name)
    parameters, _ = signature_of(KERNELS[name])
    rows, only = constructs.GIVEN.get(name, ([], False))
    drawn = [[value_of(typ, draw, each) for each, typ in parameters.items()] for _ in range(0 if only else RANDOM)]
    return [*map(list, rows), *drawn]


@pytest.mark.parametrize("name", KERNELS)
def test_a_construct_does_the_same_compiled(made, name):
    inputs = inputs_of(name)
    assert sum(agree(made[name], KERNELS[name], arguments) for arguments in inputs) >= min(3, len(inputs))


def test_all_nan_are_one_when_outcomes_are_compared():
    rows = np.zeros(2, constructs.RECORD)
    rows["part"][:, 1] = np.nan, -np.nan
    array, record = Array(constructs.RECORD, 1), Record(constructs.RECORD)
    assert bits(rows[:1], array) == bits(rows[1:], array)
    assert bits(rows[0], record) == bits(rows[1], record)
    rows["part"][1, 2] = -0.0
    assert bits(rows[:1], array) != bits(rows[1:], array)


def test_ints_beyond_53_bits_are_rounded_where_they_meet_floats(made):
    """docs/reference/kernels.md: here compiled code differs from Python."""
    large = 2**53 + 1
    assert not KERNELS["int_at_most_float"](large, 2.0**53)
    assert made["int_at_most_float"](large, 2.0**53)
    assert made["int_at_most_float"](large - 1, 2.0**53)
    assert not made["int_at_most_float"](large + 1, 2.0**53)


def test_two_views_of_one_memory_are_seen_as_one(made):
    a = np.arange(3)
    assert made["seen_as_two_kinds"](a, a.view(np.float64)) == 0x4000_0000_0000_0001
