"""Reasons for people: why a reading was late, and why a robot is in Safe Mode.

A late reading may convict an honest robot, and afterwards nobody can tell a disk from another program. So this is
asked at each turn, which costs a hundredth of a millisecond, and told when it matters.
"""

from __future__ import annotations

import contextlib
import gc
import os
import resource
import time
from typing import Any, NamedTuple

from phalanx.bti.fleet import Fleet, vouchers
from phalanx.bti.rounds import HEARD_ROUNDS_X2

# Of this thread: time on a processor, time that it could have run and did not, ns. Source: Linux, sched-stats.txt.
SCHEDSTAT = "/proc/thread-self/schedstat"
MOST_BYTES = 100
NS_PER_MS = 1e6


class Moment(NamedTuple):
    """Counters at one moment: milliseconds, and pages."""

    wall: float
    computed: float
    ready: float  # it could have run, and others did
    collected: float  # garbage
    asked: float  # waited for its trusted nodes
    pages: int  # waited for, from a disk


class Lateness:
    """Looks at the thread that makes it, until `close`."""

    def __init__(self) -> None:
        self._stat = -1
        with contextlib.suppress(OSError):  # a kernel that does not count it
            self._stat = os.open(SCHEDSTAT, os.O_RDONLY | os.O_CLOEXEC)
        self._collected = self._began = 0.0
        gc.callbacks.append(self._collects)
        self._before = self._last = self._look(0.0)
        self._doing, self._meant = "waiting", 0.0

    def turn(self, asked_ms: float) -> None:
        """A turn begins; `asked_ms`: waited for trusted nodes, ever."""
        self._before, self._last = self._last, self._look(asked_ms)

    def why(self) -> str:
        """Explain the delay between the last two turns, in words."""
        wall, computed, ready, collected, asked, pages = (b - a for a, b in zip(self._before, self._last, strict=True))
        # Who waits for an answer may wait for a processor meanwhile.
        rest = max(0.0, wall - self._meant - computed - max(ready, asked))
        return (
            f"{self._doing} took {wall:.0f} ms: {self._meant:.0f} asleep as meant, {computed:.0f} computing "
            f"({collected:.0f} of it collecting garbage), {ready:.0f} kept from a processor, {asked:.0f} until trusted "
            f"nodes answered, {rest:.0f} for something else, {pages:.0f} pages from a disk"
        )

    def did(self, what: str, meant_ms: float = 0.0) -> None:
        """This is what the turn did, and how long it means to sleep behind that."""
        self._doing, self._meant = what, max(0.0, meant_ms)

    def close(self) -> None:
        """It looks no more."""
        with contextlib.suppress(ValueError):
            gc.callbacks.remove(self._collects)
        if self._stat >= 0:
            os.close(self._stat)
            self._stat = -1

    def _look(self, asked_ms: float) -> Moment:
        ready = 0.0
        if self._stat >= 0:
            ready = int(os.pread(self._stat, MOST_BYTES, 0).split()[1]) / NS_PER_MS
        pages = resource.getrusage(resource.RUSAGE_THREAD).ru_majflt
        wall, computed = time.monotonic_ns() / NS_PER_MS, time.thread_time_ns() / NS_PER_MS
        return Moment(wall, computed, ready, self._collected, asked_ms, pages)

    def _collects(self, phase: str, _about: dict[str, Any]) -> None:
        now = time.thread_time_ns() / NS_PER_MS
        if phase == "start":
            self._began = now
        else:
            self._collected += now - self._began


def why_stopped(fleet: Fleet, now_ms: int, late_ms: float) -> str:
    """Return why too few robots vouch for the fleet's only one, as far as its c-node knows; no refusal tells it."""
    s, robot = fleet.settings[0], fleet.robot[0]
    needed, window_ms = int(s.f_max) + 1, int(s.t_audit) * HEARD_ROUNDS_X2 // 2
    peers = fleet.peer[0, : int(robot.peers)]
    heard = peers["heard"] >= now_ms - window_ms
    asked = heard & (peers["asked_ms"] >= now_ms - int(s.t_val))
    what = f"{len(vouchers(fleet, 0, now_ms))} of the {needed} that are needed vouch for it"
    within = f"in the last {window_ms / 1000:g} s"
    if robot.log_full:
        return f"{what}; its log was full"
    if late_ms > s.delta:
        return f"{what}; a reading of its was {late_ms:.0f} ms late, and its auditors allow {int(s.delta)}"
    if heard.sum() < needed:
        return f"{what}; it heard {heard.sum()} robots {within}"
    return (
        f"{what}; it heard {heard.sum()} robots {within} and asked {asked.sum()} of them: "
        "who does not vouch refuses it, does not hear it, or has stopped"
    )
