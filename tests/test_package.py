"""`import phalanx` shows what there is, and costs nothing; its example runs."""

from __future__ import annotations

import doctest
import subprocess
import sys
from importlib import import_module

import pytest

import phalanx
import phalanx.robot
import phalanx.world


@pytest.mark.parametrize("room", ["phalanx", "phalanx.robot", "phalanx.world"])
def test_it_is_light(room):
    script = f"import sys, {room}; dir({room}); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"numpy", "click", "asyncio", "yaml"} & set(done.stdout.split())


@pytest.mark.parametrize("room", [phalanx, phalanx.robot, phalanx.world], ids=lambda room: room.__name__)
def test_all_that_is_named_is_there(room):
    assert dir(room) == sorted(room.__all__)
    assert all(getattr(room, name) is not None for name in room.__all__)
    assert not hasattr(room, "no_such_room")


def test_every_room_is_told_of():
    rooms = [name for name in phalanx.__all__ if not name.startswith("__")]
    told = [line.split()[0] for line in phalanx.__doc__.splitlines() if line.startswith("    ") and ">>>" not in line]
    assert sorted(told[: len(rooms)]) == rooms
    assert all(import_module(f"phalanx.{name}").__doc__ for name in rooms)


def test_the_example_runs():
    assert doctest.testmod(phalanx) == (0, 4)
