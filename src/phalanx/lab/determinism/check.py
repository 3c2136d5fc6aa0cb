"""The checks: processes that must agree to the byte, and the first place where two of them do not."""

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

from .calls import ROBOT, Call, calls_of, maker
from .trace import LATER_S, LIVES, Step

# Beside the first process. With four in all, two strings in a set come in the same order in every one in 1 of 8 cases.
OTHERS = 3
KNOWN = [record for each in BUNDLED.values() for record in (each.commands, each.says)]
ZONES = ("UTC", "UTC-9", "UTC+7", "UTC-5")
PLAIN = "process 1"


@dataclass(frozen=True, slots=True)
class Finding:
    """First failure of a check."""

    call: int  # its number in the sequence, from 0
    at: str  # what was called, and when
    what: str  # what differs: an output, the encoding, or what was raised
    byte: int | None  # where in it, from 0; None if that is not the point
    field: str  # of the byte table, "" where the layout is the controller's own
    one: str  # what each of the two has there, and which it is
    other: str

    def __str__(self) -> str:
        where = "" if self.byte is None else f" at byte {self.byte}" + (f" ({self.field})" if self.field else "")
        beside = f"{self.one}; {self.other}" if self.other else self.one
        return f"call {self.call} ({self.at}): {self.what}{where}: {beside}"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was tried, and where it failed first; None if it did not."""

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
        """Return whether nothing was found."""
        return all(check.finding is None for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """As `phalanx sim check --json` prints it."""
        return asdict(self) | {"agrees": self.agrees}


def check_controller(words: str, seed: int = 0) -> Report:
    """Runs a controller in several ways in which auditors may run it, on the same calls, and compares every byte.

    What it finds convicts honest robots. What it does not find may still be there: it tries one machine, one life.

    Args:
        words: "FILE.py:CLASS", or the name of a controller of ours.
        seed: of the life that the controller is led through.
    Raises: UsageError: no such controller, or it fails in an honest world. Unavailable: a process ended early.
    """
    with mistakes_in(words):
        calls = calls_of(maker(words), words, seed)
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
            compare("same in all processes", ((_named(k), lives["live"]) for k, lives in enumerate(others, 1))),
            compare("same when not compiled", iter([("not compiled", plain["live"])])),
            compare("same beside another", iter([("beside another robot's", first["live_beside"])])),
            compare("same from checkpoints", iter([("gone on from it", first["live_on"])])),
            compare("same over checkpoints", iter([("gone on from it", first["live_over"])])),
            Check("raises nothing", _first_of(calls, (raised for _, _, raised, _ in straight), "METHOD raises")),
            Check("only what robots take", _first_of(calls, (refused for *_, refused in straight), "refused")),
        ),
    )


@contextlib.contextmanager
def _process(folder: Path, k: int, words: str, calls: list[Call]) -> Iterator[Callable[[], dict[str, list[Step]]]]:
    """Start process `k`, the last of which runs kernels uncompiled; yield what waits for its lives; end it."""
    job, out, said = (folder / f"{k}.{what}" for what in ("job", "out", "said"))
    turn, pure = (k, {}) if k <= OTHERS else (0, {"PHALANX_PURE": "1"})
    asked = {"controller": words, "robot": ROBOT, "turn": turn, "lives": ("live",) if k else tuple(LIVES)}
    job.write_text(json.dumps(asked | {"calls": [(call.step, call.t_ms, call.payload.hex()) for call in calls]}))
    with said.open("wb") as output:
        child = subprocess.Popen(
            [sys.executable, "-m", "phalanx.lab.determinism.trace", str(job), str(out)],
            env=os.environ | {"PYTHONHASHSEED": str(turn), "TZ": ZONES[turn]} | pure,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )

    def wait() -> dict[str, list[Step]]:
        if child.wait() != 0:
            lines = said.read_text(errors="replace").splitlines() or ["it said nothing"]
            raise Unavailable(f"a process of the check ended early: {lines[-1]}")
        lived: dict[str, list[Step]] = json.loads(out.read_text())
        return lived

    try:
        yield wait
    finally:
        child.kill()
        child.wait()


def _named(turn: int) -> str:
    return f"process {turn + 1} (hash seed {turn}, {ZONES[turn]}, {turn * LATER_S / 86_400:.1f} days later)"


def _first_of(calls: list[Call], said: Iterable[str], what: str) -> Finding | None:
    """Return the first call of which something is said; `what` names it, with "METHOD" for the controller's."""
    for k, (call, words) in enumerate(zip(calls, said, strict=True)):
        if words:
            return Finding(k, str(call), what.replace("METHOD", call.method), None, "", words, "")
    return None


def _first_difference(words: str, calls: list[Call], one: list[Step], other: list[Step], label: str) -> Finding | None:
    remembered = BUNDLED[words].remembers if words in BUNDLED else ()
    for k, (call, mine, theirs) in enumerate(zip(calls, one, other, strict=True)):
        outputs, state, raised, _ = mine
        outputs_2, state_2, raised_2, _ = theirs
        if raised != raised_2:
            said, said_2 = raised or "nothing", raised_2 or "nothing"
            return Finding(k, str(call), "raised", None, "", f"{PLAIN}: {said}", f"{label}: {said_2}")
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


def _located(told: str, told_2: str, layout: Sequence[Record], label: str) -> tuple[int, str, str, str]:
    """The first byte that differs, the field that it is in, and all bytes of that in each of the two."""
    raw, raw_2 = bytes.fromhex(told), bytes.fromhex(told_2)
    shared = min(len(raw), len(raw_2))
    byte = next((at for at in range(shared) if raw[at] != raw_2[at]), shared)
    begin, end, name = _field_at(layout, byte)
    shown, shown_2 = (each[begin:end].hex() or "nothing" for each in (raw, raw_2))
    lengths = ("", "") if len(raw) == len(raw_2) else (f" of {len(raw)}", f" of {len(raw_2)}")
    return byte, name, f"{shown}{lengths[0]} in {PLAIN}", f"{shown_2}{lengths[1]} in {label}"


def _field_at(layout: Sequence[Record], byte: int) -> tuple[int, int, str]:
    """Begin, end and name of the field that a byte is in, of records of which the last stands for all that follow."""
    end = 0
    for nth, record in enumerate(chain(layout, repeat(layout[-1])) if layout else ()):
        for field in record.all_fields:
            begin, end = end, end + field.size
            if byte < end:
                return begin, end, f"{record.name}.{field.name}" + (f" {nth}" if nth else "")
    return byte, byte + 4, ""
