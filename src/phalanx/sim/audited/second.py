"""A second processor: a thread that does a run's errands while the loop goes on (errands.py)."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np

from phalanx.bti.fleet import Fleet, memo_for
from phalanx.bti.fleet import pack as pack_fleet
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.kernel import kernel
from phalanx.memory import look, tell
from phalanx.robot import node
from phalanx.wire.fields import copy

from .ahead import fetch_body, fetch_robot
from .errands import CONTROL, DONE, ENDS, FORETELL, GIVEN, wait_for_next
from .loop import control, deliver
from .world import World, pack


@kernel
def do_errands(world: World) -> None:
    """Errands are done until there will be no more; `world` is the same world with a clock and scratch of its own."""
    e, clock = world.errands, world.clock[0]
    done = e.counts[DONE]
    while wait_for_next(e, done):
        errand = e.errand[done % len(e.errand)]
        following = e.errand[(done + 1) % len(e.errand)]
        if done + 1 < look(e.counts, GIVEN) and following.kind != FORETELL:
            fetch_robot(world, following.robot)
            if following.kind == CONTROL:
                fetch_body(world, following.robot)
        clock.now_us = errand.now_us
        if errand.kind == CONTROL:
            control(world, errand.robot)
        elif errand.kind == FORETELL:
            known = world.fleet.memo.foretold
            q, told = known.shown[errand.robot], known.told[errand.robot]
            told.refused = node.verdict(world.fleet, told.tee - 1, world.work, q, told.length, told.tee)
        else:
            copy(world.frame, 0, errand.frame, 0, errand.length)
            world.frame_len[0] = errand.length
            deliver(world, errand.robot)
        done += 1
        tell(e.counts, DONE, done)


class Second:
    """Who does the errands of a world."""

    def __init__(self, world: World, config: BtiConfig) -> None:
        clock = world.clock.copy()
        clock["alone"] = 1
        fleet = world.fleet
        foretold = fleet.memo.foretold
        memo = memo_for(len(fleet.robot), config, foretold.shown.shape[1], foretold)
        own: dict[str, Any] = {
            "clock": clock,
            "fleet": pack_fleet(
                Fleet(**{name: getattr(fleet, name) for name in Fleet._fields if name != "memo"}, memo=memo)
            ),
            "work": make_work(config),
            "frame": np.zeros_like(world.frame),
            "frame_len": np.zeros_like(world.frame_len),
            "reading": np.zeros_like(world.reading),
        }
        self._world = pack(World(**{name: own.get(name, getattr(world, name)) for name in World._fields}))
        self._world.errands.counts[ENDS] = 1
        do_errands(self._world)  # compiles

    @contextlib.contextmanager
    def working(self) -> Iterator[None]:
        """Errands are done as they come, and all of them at the end."""
        errands = self._world.errands
        errands.steps[:] = self._world.fleet.robot["step"]
        errands.counts[ENDS], errands.on[0] = 0, 1
        thread = threading.Thread(target=do_errands, args=(self._world,))
        try:
            thread.start()
            yield
        finally:
            errands.counts[ENDS], errands.on[0] = 1, 0
            if thread.ident is not None:
                thread.join()
        assert not self._world.clock[0].said, "a controller said something when it had told that it would not"
