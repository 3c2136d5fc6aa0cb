"""Compute, store and compare the digests of cases: for every simulated second one digest in each category."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import observe
from .cases import Case

FOLDER = Path(__file__).parent / "digests"
CATEGORY = {
    "body": "bodies",
    "packet": "packets",
    "radio": "packets",
    "verdict": "audits",
    "audit": "audits",
    "stop": "stops",
    "chain": "chains",
    "token": "tokens",
    "mission": "missions",
    "outcome": "outcome",
}
# Hexadecimal digits kept of each SHA-256.
DIGITS = 6
NOTHING = "-"
Digests = dict[str, str]


class DigestSink:
    """Hashes the events of a case by world, second and category."""

    period_us = observe.SECOND_US
    fine = False

    def __init__(self) -> None:
        self._hashes: defaultdict[tuple[int, int, str], Any] = defaultdict(hashlib.sha256)

    def event(self, world: int, t_us: int, kind: str, robot: int, data: bytes) -> None:
        """Hash one event into the second in which it happened."""
        second = -(-t_us // observe.SECOND_US)
        head = f"{t_us} {kind} {robot} {len(data)} ".encode()
        self._hashes[world, second, CATEGORY[kind]].update(head + data)

    def rows(self, world: int, t_us: int, kind: str, rows: list[bytes]) -> None:
        """Hash one sample of all robots."""
        self.event(world, t_us, kind, observe.ALL, b"".join(rows))

    def digests(self) -> list[Digests]:
        """Return for each world and category the digests of its seconds from 0 on, NOTHING where no event was."""
        kept = {key: made.hexdigest()[:DIGITS] for key, made in self._hashes.items()}
        worlds = range(1 + max(world for world, _, _ in kept))
        return [_of_world({key[1:]: told for key, told in kept.items() if key[0] == world}) for world in worlds]


def _of_world(kept: dict[tuple[int, str], str]) -> Digests:
    last = max((second for second, _ in kept), default=0)
    found = dict.fromkeys(category for category in CATEGORY.values() if any(each == category for _, each in kept))
    return {
        category: " ".join(kept.get((second, category), NOTHING) for second in range(last + 1)).rstrip(f" {NOTHING}")
        for category in found
    }


def digests_of(case: Case) -> list[Digests]:
    """Run a case and return its digests."""
    sink = DigestSink()
    with observe.observed(sink):
        observe.RUNNERS[case.runner](sink, **case.inputs)
    return sink.digests()


@dataclass(frozen=True, slots=True)
class Difference:
    """The first digest of a case that differs from the recorded one."""

    case: str
    where: str

    def __str__(self) -> str:
        return f"{self.case}: {self.where}"


def first_difference(case: Case, recorded: dict[str, Any] | None, digests: list[Digests]) -> Difference | None:
    """Return where `digests` first differ from the recorded ones, or None."""
    if recorded is None:
        return Difference(case.name, "not recorded")
    if recorded["inputs"] != case.inputs:
        return Difference(case.name, "recorded with other inputs")
    differing: list[tuple[int, int, str]] = []
    worlds = recorded["worlds"]
    for world in range(max(len(worlds), len(digests))):
        old, new = (each[world] if world < len(each) else {} for each in (worlds, digests))
        for category in dict.fromkeys((*old, *new)):
            was, now = old.get(category, "").split(), new.get(category, "").split()
            longest = max(len(was), len(now))
            was += [NOTHING] * (longest - len(was))
            now += [NOTHING] * (longest - len(now))
            differing += [(world, k, category) for k in range(longest) if was[k] != now[k]][:1]
    # The outcome is stored at second 0 and known at the end.
    differing.sort(key=lambda each: (each[2] == "outcome", each))
    if not differing:
        return None
    world, second, category = differing[0]
    if category == "outcome":
        return Difference(case.name, "the final outcome differs, and nothing before it")
    others = sorted({each[2] for each in differing[1:] if each[:2] == (world, second)} - {category, "outcome"})
    also = f" (also {', '.join(others)})" if others else ""
    which = f"world {world}, " if len(worlds) > 1 else ""
    return Difference(case.name, f"{which}second {second}: {category} differ{also}")


def load(group: str) -> dict[str, Any]:
    """Return the recorded cases of a group by name."""
    path = FOLDER / f"{group}.json"
    recorded: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return recorded


def store(group: str, recorded: dict[str, Any]) -> None:
    """Write the recorded cases of a group: a line for each case, so that a diff shows which cases changed."""
    lines = [f"{json.dumps(name)}: {json.dumps(told, separators=(',', ':'))}" for name, told in recorded.items()]
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{group}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
