"""Explain why a reading was late, and why a robot is in Safe Mode.

A late reading can convict an honest robot, and its cause (such as a disk or another program) cannot be found
afterwards. So counters are read at each turn, which takes 10 µs, and reported when needed.
"""

from __future__ import annotations

import contextlib
import gc
import os
import resource
import time
from typing import Any, NamedTuple

from phalanx.bti.fleet import Fleet, held_tokens
from phalanx.bti.rounds import HEARD_ROUNDS_X2

# Of this thread: time on a processor, time runnable but not running, ns. Source: Linux, sched-stats.txt.
SCHEDSTAT = "/proc/thread-self/schedstat"
MOST_BYTES = 100
NS_PER_MS = 1e6


class Moment(NamedTuple):
    """Counters at one moment: milliseconds, and pages."""

    wall: float
    computed: float
    ready: float  # runnable, but not running
    collected: float  # collecting garbage
    asked: float  # waiting for its trusted nodes
    pages: int  # loaded from a disk


class Lateness:
    """Monitors the thread that creates it, until `close`."""

    def __init__(self) -> None:
        self._stat = -1
        with contextlib.suppress(OSError):  # a kernel without this counter
            self._stat = os.open(SCHEDSTAT, os.O_RDONLY | os.O_CLOEXEC)
        self._collected = self._began = 0.0
        gc.callbacks.append(self._on_gc)
        self._before = self._last = self._look(0.0)
        self._doing, self._meant = "waiting", 0.0

    def turn(self, asked_ms: float) -> None:
        """Begin a turn; `asked_ms` is the total time spent waiting for trusted nodes."""
        self._before, self._last = self._last, self._look(asked_ms)

    def why(self) -> str:
        """Return the cause of the delay between the last two turns, as text."""
        wall, computed, ready, collected, asked, pages = (b - a for a, b in zip(self._before, self._last, strict=True))
        # Waiting for an answer and waiting for a processor can overlap.
        rest = max(0.0, wall - self._meant - computed - max(ready, asked))
        return (
            f"{self._doing} took {wall:.0f} ms: {self._meant:.0f} sleeping as planned, {computed:.0f} computing "
            f"({collected:.0f} of it collecting garbage), {ready:.0f} kept from a processor, {asked:.0f} waiting for "
            f"trusted nodes, {rest:.0f} other, {pages:.0f} pages from a disk"
        )

    def did(self, what: str, meant_ms: float = 0.0) -> None:
        """Note what the turn did, and how long it plans to sleep afterwards."""
        self._doing, self._meant = what, max(0.0, meant_ms)

    def close(self) -> None:
        """Stop monitoring."""
        with contextlib.suppress(ValueError):
            gc.callbacks.remove(self._on_gc)
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

    def _on_gc(self, phase: str, _about: dict[str, Any]) -> None:
        now = time.thread_time_ns() / NS_PER_MS
        if phase == "start":
            self._began = now
        else:
            self._collected += now - self._began


def why_stopped(fleet: Fleet, now_ms: int, late_ms: float) -> str:
    """Return why too few robots vouch for this one, as far as its c-node knows; auditors do not send reasons."""
    s, robot = fleet.settings[0], fleet.robot[0]
    needed, window_ms = int(s.f_max) + 1, int(s.t_audit) * HEARD_ROUNDS_X2 // 2
    peers = fleet.peer[0, : int(robot.peers)]
    heard = peers["heard"] >= now_ms - window_ms
    asked = heard & (peers["asked_ms"] >= now_ms - int(s.t_val))
    what = f"{len(held_tokens(fleet, 0, now_ms))} of {needed} needed robots vouch for it"
    within = f"in the last {window_ms / 1000:g} s"
    if robot.log_full:
        return f"{what}; its log was full"
    if late_ms > s.delta:
        return f"{what}; one of its readings was {late_ms:.0f} ms late, and its auditors allow {int(s.delta)} ms"
    if heard.sum() < needed:
        return f"{what}; it heard {heard.sum()} robots {within}"
    return (
        f"{what}; it heard {heard.sum()} robots {within} and asked {asked.sum()} of them: "
        "the others refuse it, do not receive it, or have stopped"
    )
