"""Publish a robot's state: a JSON file for its owner only, replaced atomically each second."""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path
from typing import Any

from phalanx.bti.fleet import held_tokens
from phalanx.config.written import read_at_most
from phalanx.errors import PhalanxError, UsageError
from phalanx.net.private_file import write_whole

from .life import Life, memory_kb

EVERY_S = 1.0
MOST_BYTES = 1 << 20
HINT = "start the robot: phalanx robot run"
OLD_S = 5.0


def state_of(life: Life) -> dict[str, Any]:
    """Return the state that `phalanx robot status --json` prints."""
    robot = life.fleet.robot[0]
    runtime = life.runtime
    assert runtime
    deviated_ms = life.first_deviation_ms
    now_ms, t_val_s = life.clock.now_ms(), life.scenario.bti.t_val_ms / 1000
    return {
        "robot": life.id,
        "mission": life.mission,
        "scenario": life.scenario.name,
        "pid": os.getpid(),
        "told_s": time.time(),
        "began_monotonic_s": life.began_s,
        "lived_s": (now_ms - life.began_ms) / 1000,
        "safe_mode": runtime.in_safe_mode,
        "why_stopped": life.why_stopped,
        "why_ended": life.why_ended,
        "no_reading": life.no_reading and {"for_s": (now_ms - life.no_reading[0]) / 1000, "why": life.no_reading[1]},
        "tokens": [
            {"auditor": auditor, "age_s": t_val_s - left_s, "left_s": left_s}
            for auditor, left_s in sorted(held_tokens(life.fleet, 0, now_ms))
        ],
        "tokens_needed": life.scenario.bti.tokens_needed,
        "tokens_got": int(robot.tokens_got),
        "requests_sent": int(robot.requests_sent),
        "given": [{"auditee": auditee, **_ended(each, now_ms)} for auditee, each in life.given.items()],
        "refused": [
            {"auditee": auditee, "reason": why.name.lower().replace("_", " "), **_ended(each, now_ms)}
            for (auditee, why), each in life.refused.items()
        ],
        "log_bytes": int(robot.log_len),
        "log_bytes_max": int(robot.log_max),
        "frames_refused": {why: n for why, n in life.radio.refused.items() if n},
        "advice": {"taken": life.far.taken, "rubbish": life.far.rubbish} if life.far else {},
        "longest_ms": {what: round(took, 3) for what, took in life.longest_ms.items()},
        "why_late": life.why_late,
        "memory_kb": memory_kb(),
        "memory_began_kb": life.memory_began_kb,
        "cpu_share": round(life.cpu_share, 4),
        "attack": life.attack.name if life.attack else None,
        "first_deviation_s": None if deviated_ms is None else (deviated_ms - life.began_ms) / 1000,
    }


def _ended(audits: tuple[int, int], now_ms: int) -> dict[str, Any]:
    return {"times": audits[0], "last_s_ago": (now_ms - audits[1]) / 1000}


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Write the state to the file. Raises: Unavailable: it cannot be written."""
    write_whole(path, json.dumps(state).encode() + b"\n", "use another folder", private=True)


def read_state(path: Path) -> dict[str, Any]:
    """Read the state that a robot published last. Raises: UsageError: there is none."""
    try:
        if not path.is_file():  # reading a pipe would block
            raise UsageError(f"{path} is not a file")
        state: dict[str, Any] = json.loads(read_at_most(path, MOST_BYTES, HINT))
        float(state["told_s"])
        if type(state["pid"]) is not int or not 0 < state["pid"] < 1 << 31:
            raise ValueError("no process")
    except (PhalanxError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{path} is not the state file of a robot", HINT) from error
    return state


def is_running(state: dict[str, Any]) -> bool:
    """Return whether the robot's process exists and updates its state."""
    with contextlib.suppress(PermissionError):  # a process of another user
        try:
            os.kill(state["pid"], 0)
        except ProcessLookupError:
            return False
    return bool(abs(time.time() - state["told_s"]) < OLD_S)
