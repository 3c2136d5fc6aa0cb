"""Every kernel of the package does the same compiled and as Python, on recorded inputs and on others made of them.

Inputs come from small runs: a flock with a liar, the guard with a hostile planner, wheels that are driven, and missions
with scans, orders and people. All run as Python and are recorded (recorded_calls.py). A kernel that none of them reaches
gets values of the same types that others were given, and random numbers. Two of the runs give the same events
compiled, byte for byte.
"""

from __future__ import annotations

import fcntl
import importlib
import os
import pickle
import random
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from harness import agree, value_of
from phalanx import _kernels
from phalanx.kernel import PURE
from phalanx_compiler.value_types import BOOL, FLOAT, INT, Array, Bundle, Record, Tuple, signature_of

KIT = Path(__file__).parents[1] / "kit"
pytestmark = pytest.mark.skipif(PURE, reason="no kernel is compiled")
# So many of the 413 are reached by the runs; the rest get drawn inputs. More may be drawn only if this line says so.
REACHED_AT_LEAST = 366
DRAWN = 40
TRUSTED = "phalanx.bti.trusted."
NAMES = sorted(_kernels.names)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return the file of recorded calls; the events are beside it."""
    # Workers of pytest-xdist share what the first of them has recorded.
    base = tmp_path_factory.getbasetemp()
    path = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "calls.pickle"
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            env = os.environ | {"PHALANX_PURE": "1"}
            subprocess.run([sys.executable, KIT / "recorded_calls.py", path], env=env, check=True, capture_output=True)
    return path


@pytest.fixture(scope="module")
def records(recorded):
    return pickle.loads(recorded.read_bytes())


@pytest.fixture(scope="module")
def kernels():
    """Return all compiled kernels of the package, by name."""
    for name in NAMES:
        importlib.import_module(name.rpartition(".")[0])
    modules = [module for name, module in list(sys.modules.items()) if name.split(".")[0] == "phalanx"]
    values = [value for module in modules for value in vars(module).values()]
    return {each.entry[0]: each for each in values if isinstance(each, _kernels.Kernel)}


def packed(value, typ):
    """Return a recorded argument as compiled kernels take it."""
    if isinstance(typ, Bundle):
        fields = [packed(getattr(value, name), of) for name, (_, of) in typ.places.items()]
        return typ.cls.__packed__(typ.cls(*fields))
    if isinstance(typ, Tuple):
        items = [packed(each, of) for each, of in zip(value, typ.items, strict=True)]
        return typ.cls(*items) if typ.cls else tuple(items)
    return np.ascontiguousarray(value) if isinstance(typ, Array) and not value.flags.c_contiguous else value


def taken(record, function):
    parameters, _ = signature_of(function)
    arguments = pickle.loads(zlib.decompress(record))
    return [packed(each, typ) for each, typ in zip(arguments, parameters.values(), strict=True)]


def changed(value, typ, draw):
    """Return a copy of an argument with some other bytes in its row, or another number near it."""
    if isinstance(typ, Array) and typ.dtype == np.uint8 and value.size:
        value = value.copy()
        for _ in range(draw.randrange(1, 5)):
            value.reshape(-1)[draw.randrange(value.size)] = draw.choice([0, 1, 255, draw.randrange(256)])
    elif isinstance(typ, Array) and typ.dtype == np.float64 and value.size:
        value = value.copy()
        with np.errstate(all="ignore"):
            value.reshape(-1)[draw.randrange(value.size)] *= draw.choice([0.0, -1.0, 1.01, 3.0])
    elif typ == FLOAT and draw.random() < 0.5:
        return float(value) * draw.choice([0.0, -1.0, 1.01, 0.5])
    elif typ == BOOL and draw.random() < 0.3:
        return not value
    elif isinstance(typ, Tuple) and not typ.cls:
        return tuple(changed(each, of, draw) for each, of in zip(value, typ.items, strict=True))
    return value


@pytest.mark.parametrize("name", NAMES)
def test_a_kernel_does_the_same_both_ways(name, kernels, records):
    made = kernels[name]
    plain = made.py_func
    if name not in records:
        assert not name.startswith(TRUSTED), "record a run that calls it: its C trusts the bytes of a node"
        assert try_drawn(name, kernels, records) >= 1, "no input leads to a result: record a run that calls it"
        return
    gave = 0
    for record in records[name]:
        arguments = taken(record, plain)
        gave += agree(made, plain, arguments)
        try_changed(made, arguments, 1)
    assert gave == len(records[name])


@pytest.mark.long
def test_kernels_do_the_same_both_ways_on_more_inputs(kernels, records):
    for name, each in kernels.items():
        for record in records.get(name, ()):
            try_changed(each, taken(record, each.py_func), 5)


def try_changed(made, arguments, count):
    """Changed bytes may lead anywhere in Python or raise in both, but the process goes on."""
    name, types = made.entry[0], list(signature_of(made.py_func)[0].values())
    draw = random.Random(f"{name} {count}")
    # The trusted nodes' C trusts its own memory.
    for _ in range(0 if name.startswith(TRUSTED) else count):
        others = [changed(each, typ, draw) for each, typ in zip(arguments, types, strict=True)]
        agree(made, made.py_func, others, is_made_up=True)


def try_drawn(name, kernels, records):
    """Call a kernel that no run reaches; return how often it gave a result."""
    made, draw = kernels[name], random.Random(name)
    parameters, _ = signature_of(made.py_func)
    gave = 0
    for _ in range(DRAWN):
        arguments = [drawn(typ, each, kernels, records, draw) for each, typ in parameters.items()]
        gave += agree(made, made.py_func, arguments, is_made_up=True)
    return gave


def drawn(typ, name, kernels, records, draw):
    """Return a value that some kernel was given for a parameter of this type, if it is no number."""
    if typ == INT:
        return draw.choice([0, 1, 2, 3, 5, 20])
    if typ == FLOAT:
        return draw.choice([0.0, 1.0, -0.5, draw.uniform(-3, 3), draw.uniform(0, 40)])
    if isinstance(typ, Tuple):
        items = [drawn(each, "", kernels, records, draw) for each in typ.items]
        return typ.cls(*items) if typ.cls else tuple(items)
    if isinstance(typ, (Array, Bundle, Record)):
        others = [each for each in sorted(records) if typ in signature_of(kernels[each].py_func)[0].values()]
        alike = [each for each in others if name in signature_of(kernels[each].py_func)[0]] or others
        if alike:
            other = draw.choice(alike)
            parameters, _ = signature_of(kernels[other].py_func)
            arguments = taken(draw.choice(records[other]), kernels[other].py_func)
            return draw.choice([each for each, of in zip(arguments, parameters.values(), strict=True) if of == typ])
    return value_of(typ, draw, name)


def test_all_kernels_are_tried_and_most_of_them_on_recorded_inputs(kernels, records):
    assert set(kernels) == set(NAMES)
    assert set(records) <= set(NAMES)
    assert len(records) >= REACHED_AT_LEAST


def test_a_liar_and_a_mission_give_the_same_events_both_ways(recorded, tmp_path):
    env = os.environ | {"PHALANX_PURE": "0"}
    subprocess.run(
        [sys.executable, KIT / "run_events.py", tmp_path / "events"], env=env, check=True, capture_output=True
    )
    texts = (tmp_path / "events").read_text(), Path(f"{recorded}.events").read_text()
    compiled, uncompiled = (text.split("\n") for text in texts)
    assert {"body", "packet", "verdict", "chain", "token", "mission", "outcome"} <= {
        line.split()[2] for line in compiled
    }
    differing = next((pair for pair in zip(compiled, uncompiled, strict=False) if pair[0] != pair[1]), None)
    assert differing is None
    assert len(compiled) == len(uncompiled)
