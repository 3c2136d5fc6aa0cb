"""Run a controller through recorded calls in a new process: python -m phalanx.lab.determinism.trace JOB OUT.

The controller runs several times, in ways that auditors may use. Conditions that must not matter differ between the
processes: clocks, time zone and memory addresses, and the order of sets, by the process's hash seed.
"""

from __future__ import annotations

import datetime as dt
import json
import random
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from phalanx.config import BtiConfig
from phalanx.robot.controllers.dispatch import BUNDLED
from phalanx.robot.controllers.python_controller import (
    Act,
    Controller,
    Output,
    OwnMistake,
    checked_outputs,
    checked_state,
)
from phalanx.wire.record import MalformedRecord

from .calls import ADVICE, FRAME, Call, Endless, Make, controller_factory, watch_call

# Result of one call: type and bytes of each output, encoded state after the call, the exception, and the reason why
# the body, the radio or the checkpoint would reject a result.
Step = tuple[list[tuple[str, str]], str, str, str]
# Layouts by first byte and length.
COMMANDS, BROADCASTS = (
    {(record.tag, record.size): record for record in records}
    for records in ([each.commands for each in BUNDLED.values()], [each.says for each in BUNDLED.values()])
)
# Neither whole days nor whole hours, so that hour, minute and second of the day differ too.
LATER_S = 118_383.0
# Number of calls by which the other robot's controller is behind, so that state they share would differ.
BEHIND = 7


def live(make: Make, rob_id: int, calls: list[Call]) -> list[Step]:
    """Run one controller through all calls."""
    controller = make(rob_id)
    return [_step(controller, call) for call in calls]


def run_with_other(make: Make, rob_id: int, calls: list[Call]) -> list[Step]:
    """Run as in `live`, while another robot's controller in the same process receives the calls with a delay."""
    controller, other = make(rob_id), make(rob_id + 1)
    steps = []
    for k, call in enumerate(calls):
        _step(other, calls[max(0, k - BEHIND)])
        steps.append(_step(controller, call))
    return steps


def run_relayed(make: Make, rob_id: int, calls: list[Call]) -> list[Step]:
    """Run each call in a new controller that decodes the last encoding, as an auditor does."""
    return _relayed(calls, make(rob_id), lambda: make(rob_id))


def run_in_turns(make: Make, rob_id: int, calls: list[Call]) -> list[Step]:
    """Run the calls in two controllers in turn: each decodes the other's encoding over its own old state."""
    first, second = make(rob_id), make(rob_id)
    turns = [second, first]

    def other() -> Controller:
        turns.append(turns.pop(0))
        return turns[-1]

    return _relayed(calls, first, other)


LIVES = {each.__name__: each for each in (live, run_with_other, run_relayed, run_in_turns)}


def _relayed(calls: list[Call], controller: Controller, following: Callable[[], Controller]) -> list[Step]:
    steps: list[Step] = []
    for call in calls:
        try:
            encoding = controller.encode()
            controller = following()
            controller.decode(encoding)
            decoded = controller.encode()
        except Exception as error:  # noqa: BLE001 - recorded as the result
            steps.append(([], "", f"decode: {_describe(error)}", ""))
            continue
        step = _step(controller, call)
        steps.append(step if decoded == encoding else ([], decoded.hex(), "decode, then encode: other bytes", ""))
    return steps


def _step(controller: Controller, call: Call) -> Step:
    outputs: list[Output] = []
    raised = refused = ""
    try:
        with watch_call(controller, call.method, str(call)):
            if call.step == FRAME:
                controller.on_recv(call.t_ms, call.payload)
            elif call.step == ADVICE:
                controller.on_advice(call.payload)
            else:
                answer = controller.on_input(call.step, call.t_ms, call.payload)
                outputs = checked_outputs(answer, BtiConfig().packet_max_bytes, controller)
                refused = _unfit(outputs)
    except Endless:
        raise
    except OwnMistake as error:
        refused = str(error)
    except Exception as error:  # noqa: BLE001 - recorded as the result
        raised = _describe(error)
    try:
        state = checked_state(controller.encode(), _room(controller.state_bytes), controller)
    except OwnMistake as error:
        state, refused = b"", refused or str(error)
    except Exception as error:  # noqa: BLE001 - as above
        state, raised = b"", raised or f"encode: {_describe(error)}"
    return [(type(output).__name__, output.payload.hex()) for output in outputs], state.hex(), raised, refused


def _unfit(outputs: list[Output]) -> str:
    """Describe the first output that the body or the neighbours could not use; "" if all are usable."""
    for output in outputs:
        layouts = COMMANDS if isinstance(output, Act) else BROADCASTS
        known = layouts.get((output.payload[0], len(output.payload)))
        try:
            if known:
                known.decode(output.payload)
            elif isinstance(output, Act):
                return f"on_input returned a bad command: {len(output.payload)} bytes, the first {output.payload[0]}"
        except MalformedRecord as error:
            return f"on_input returned an invalid {type(output).__name__}: {error}"
    return ""


def _room(state_bytes: int) -> int:
    """Return the checkpoint size allowed by a scenario without its own limit."""
    bti = BtiConfig()
    return replace(bti, state_bytes=max(bti.state_bytes, state_bytes)).checkpoint_capacity_bytes


def _describe(error: Exception) -> str:
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {error}".splitlines()[0]


def _shake(turn: int) -> list[bytearray]:
    """Set the clocks ahead and fragment the memory; the fragmentation lasts while the returned list exists."""
    _set_clocks(turn * LATER_S)
    chance = random.Random(turn)  # noqa: S311 - no secret, and independent of the global generator
    kept = [bytearray(chance.randrange(16, 2048)) for _ in range(20_000)]
    chance.shuffle(kept)
    del kept[::2]
    return kept


def _set_clocks(ahead_s: float) -> None:
    for name in ("time", "monotonic", "perf_counter", "process_time", "thread_time", "clock_gettime"):
        at: Callable[..., float] = getattr(time, name)
        setattr(time, name, lambda *which, at=at: at(*which) + ahead_s)
        at_ns: Callable[..., int] = getattr(time, f"{name}_ns")
        setattr(time, f"{name}_ns", lambda *which, at_ns=at_ns: at_ns(*which) + int(ahead_s) * 1_000_000_000)
    for name in ("gmtime", "localtime"):
        of: Callable[[float], time.struct_time] = getattr(time, name)
        setattr(time, name, lambda when=None, of=of: of(time.time() if when is None else when))

    class Later(dt.datetime):
        @classmethod
        def now(cls, tz: dt.tzinfo | None = None) -> dt.datetime:  # type: ignore[override]
            return dt.datetime.fromtimestamp(time.time(), tz)

        @classmethod
        def utcnow(cls) -> dt.datetime:  # type: ignore[override]
            return dt.datetime.fromtimestamp(time.time(), dt.UTC).replace(tzinfo=None)

        @classmethod
        def today(cls) -> dt.datetime:  # type: ignore[override]
            return cls.now()

    dt.datetime = Later  # type: ignore[misc]


def main(job: Path, out: Path) -> None:
    """Run the job's sequences, and write their results to `out`."""
    settings: dict[str, Any] = json.loads(job.read_text())
    kept = _shake(settings["turn"]) if settings["turn"] else []
    make = controller_factory(settings["controller"])
    calls = [Call(step, t_ms, bytes.fromhex(payload)) for step, t_ms, payload in settings["calls"]]
    results = {name: LIVES[name](make, settings["robot"], calls) for name in settings["lives"]}
    del kept
    out.write_text(json.dumps(results))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
