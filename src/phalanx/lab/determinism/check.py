"""Run a controller in several processes that must agree to the byte, and find the first difference."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable
from phalanx.robot.controllers.dispatch import BUNDLED
from phalanx.scenarios.own import mistakes_in
from phalanx.wire.record import Record

from .calls import ROBOT, Call, calls_of, controller_factory
from .trace import LATER_S, LIVES, Step

# Processes in addition to the first. With four, two strings in a set have the same order in all in 1 of 8 cases.
OTHERS = 3
KNOWN = [record for each in BUNDLED.values() for record in (each.commands, each.says)]
ZONES = ("UTC", "UTC-9", "UTC+7", "UTC-5")
PLAIN = "process 1"


@dataclass(frozen=True, slots=True)
class Finding:
    """First failure of a check."""

    call: int  # number in the sequence, from 0
    at: str  # the call and its time
    what: str  # the part that differs: an output, the encoding, or the exception
    byte: int | None  # offset of the difference; None if it is not in bytes
    field: str  # field of the byte table; "" if the layout is the controller's own
    one: str  # bytes or text in each of the two processes, with their labels
    other: str

    def __str__(self) -> str:
        where = "" if self.byte is None else f" at byte {self.byte}" + (f" ({self.field})" if self.field else "")
        beside = f"{self.one}; {self.other}" if self.other else self.one
        return f"call {self.call} ({self.at}): {self.what}{where}: {beside}"


@dataclass(frozen=True, slots=True)
class Check:
    """One property that was checked, and its first violation; None if it holds."""

    name: str
    finding: Finding | None


@dataclass(frozen=True, slots=True)
class Report:
    """Results of all checks of a controller."""

    controller: str
    seed: int
    calls: int
    checks: tuple[Check, ...]

    @property
    def agrees(self) -> bool:
        """Return whether all checks passed."""
        return all(check.finding is None for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """Return the report as `phalanx sim check --json` prints it."""
        return asdict(self) | {"agrees": self.agrees}


def check_controller(words: str, seed: int = 0) -> Report:
    """Run a controller in several ways that auditors may use, on the same calls, and compare every byte.

    Any difference convicts honest robots. Passing is no proof: the check tests one machine and one sequence of calls.

    Args:
        words: "FILE.py:CLASS", or the name of a bundled controller.
        seed: of the simulated run that the calls come from.
    Raises: UsageError: no such controller, or it fails in an honest world. Unavailable: a process ended early.
    """
    with mistakes_in(words):
        calls = calls_of(controller_factory(words), words, seed)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        waits = [stack.enter_context(_process(Path(folder), k, words, calls)) for k in range(OTHERS + 2)]
        first, *others, plain = [wait() for wait in waits]
    straight = first["live"]

    def compare(name: str, lives: Iterator[tuple[str, list[Step]]]) -> Check:
        found = ((label, _first_difference(words, calls, straight, steps, label)) for label, steps in lives)
        return Check(name, next((finding for _, finding in found if finding), None))

    return Report(
        words,
        seed,
        len(calls),
        (
            compare("same in all processes", ((_label(k), lives["live"]) for k, lives in enumerate(others, 1))),
            compare("same when not compiled", iter([("not compiled", plain["live"])])),
            compare("same beside another", iter([("beside another robot's", first["run_with_other"])])),
            compare("same from checkpoints", iter([("gone on from it", first["run_relayed"])])),
            compare("same over checkpoints", iter([("gone on from it", first["run_in_turns"])])),
            Check("raises nothing", _first_of(calls, (raised for _, _, raised, _ in straight), "METHOD raises")),
            Check("only what robots take", _first_of(calls, (refused for *_, refused in straight), "refused")),
        ),
    )


@contextlib.contextmanager
def _process(folder: Path, k: int, name: str, calls: list[Call]) -> Iterator[Callable[[], dict[str, list[Step]]]]:
    """Start process `k`, of which the last runs kernels uncompiled; yield a function that waits for its results."""
    job, out, log = (folder / f"{k}.{kind}" for kind in ("job", "out", "log"))
    turn, pure = (k, {}) if k <= OTHERS else (0, {"PHALANX_PURE": "1"})
    settings = {"controller": name, "robot": ROBOT, "turn": turn, "lives": ("live",) if k else tuple(LIVES)}
    job.write_text(json.dumps(settings | {"calls": [(call.step, call.t_ms, call.payload.hex()) for call in calls]}))
    with log.open("wb") as output:
        child = subprocess.Popen(
            [sys.executable, "-m", "phalanx.lab.determinism.trace", str(job), str(out)],
            env=os.environ | {"PYTHONHASHSEED": str(turn), "TZ": ZONES[turn]} | pure,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )

    def wait() -> dict[str, list[Step]]:
        if child.wait() != 0:
            lines = log.read_text(errors="replace").splitlines() or ["no output"]
            raise Unavailable(f"a process of the check ended early: {lines[-1]}")
        results: dict[str, list[Step]] = json.loads(out.read_text())
        return results

    try:
        yield wait
    finally:
        child.kill()
        child.wait()


def _label(turn: int) -> str:
    return f"process {turn + 1} (hash seed {turn}, {ZONES[turn]}, {turn * LATER_S / 86_400:.1f} days later)"


def _first_of(calls: list[Call], texts: Iterable[str], what: str) -> Finding | None:
    """Return the first call whose text is not empty; `what` names the finding, "METHOD" in it the method."""
    for k, (call, text) in enumerate(zip(calls, texts, strict=True)):
        if text:
            return Finding(k, str(call), what.replace("METHOD", call.method), None, "", text, "")
    return None


def _first_difference(name: str, calls: list[Call], one: list[Step], other: list[Step], label: str) -> Finding | None:
    remembered = BUNDLED[name].remembers if name in BUNDLED else ()
    for k, (call, mine, theirs) in enumerate(zip(calls, one, other, strict=True)):
        outputs, state, raised, _ = mine
        outputs_2, state_2, raised_2, _ = theirs
        if raised != raised_2:
            texts = raised or "nothing", raised_2 or "nothing"
            return Finding(k, str(call), "raised", None, "", f"{PLAIN}: {texts[0]}", f"{label}: {texts[1]}")
        if len(outputs) != len(outputs_2):
            counts = f"{PLAIN}: {len(outputs)}", f"{label}: {len(outputs_2)}"
            return Finding(k, str(call), "number of outputs", None, "", *counts)
        for nth, ((kind, payload), (kind_2, payload_2)) in enumerate(zip(outputs, outputs_2, strict=True), 1):
            if (kind, payload) != (kind_2, payload_2):
                what = f"output {nth}, {kind}" + ("" if kind == kind_2 else f" or {kind_2}")
                raw = bytes.fromhex(payload)
                known = [each for each in KNOWN if len(raw) == each.size and raw[0] == each.tag]
                return Finding(k, str(call), what, *_located(payload, payload_2, known[:1], label))
        if state != state_2:
            return Finding(k, str(call), "encode", *_located(state, state_2, remembered, label))
    return None


def _located(one: str, other: str, layout: Sequence[Record], label: str) -> tuple[int, str, str, str]:
    """Return the first differing byte, its field, and the bytes of that field in both encodings."""
    raw, raw_2 = bytes.fromhex(one), bytes.fromhex(other)
    shared = min(len(raw), len(raw_2))
    byte = next((at for at in range(shared) if raw[at] != raw_2[at]), shared)
    begin, end, name = _field_at(layout, byte)
    shown, shown_2 = (each[begin:end].hex() or "nothing" for each in (raw, raw_2))
    lengths = ("", "") if len(raw) == len(raw_2) else (f" of {len(raw)}", f" of {len(raw_2)}")
    return byte, name, f"{shown}{lengths[0]} in {PLAIN}", f"{shown_2}{lengths[1]} in {label}"


def _field_at(layout: Sequence[Record], byte: int) -> tuple[int, int, str]:
    """Return begin, end and name of the field at a byte; the last record repeats for the rest of the encoding."""
    end = 0
    for nth, record in enumerate(chain(layout, repeat(layout[-1])) if layout else ()):
        for field in record.all_fields:
            begin, end = end, end + field.size
            if byte < end:
                return begin, end, f"{record.name}.{field.name}" + (f" {nth}" if nth else "")
    return byte, byte + 4, ""
