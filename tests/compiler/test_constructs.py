"""Every construct of the subset gives the same compiled and as plain Python, to the bit."""

from __future__ import annotations

import random

import constructs
import numpy as np
import pytest
from harness import agree, compiled, kernels_of, value_of

from phalanx_compiler.kinds import signature_of

KERNELS = {each.__name__: each for each in kernels_of(constructs)}
RANDOM = 150


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return compiled(list(KERNELS.values()), tmp_path_factory.mktemp("constructs"))


def inputs_of(name: str) -> list[list[object]]:
    draw = random.Random(name)
    parameters, _ = signature_of(KERNELS[name])
    rows, only = constructs.GIVEN.get(name, ([], False))
    drawn = [[value_of(kind, draw, each) for each, kind in parameters.items()] for _ in range(0 if only else RANDOM)]
    return [*map(list, rows), *drawn]


@pytest.mark.parametrize("name", KERNELS)
def test_a_construct_does_the_same_compiled(made, name):
    inputs = inputs_of(name)
    assert sum(agree(made[name], KERNELS[name], arguments) for arguments in inputs) >= min(3, len(inputs))


def test_two_views_of_one_memory_are_seen_as_one(made):
    a = np.arange(3)
    assert made["seen_as_two_kinds"](a, a.view(np.float64)) == 0x4000_0000_0000_0001
