"""The table that runs come to: a line for each attack, protocol and defence, and its CSV."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median
from typing import Any

from phalanx.config.defence import DEFENCES
from phalanx.io.private_file import write_whole
from phalanx.robot.attacks.library import ATTACKS


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """What an attack came to under a defence in a protocol, over the seeds; None where nobody measures that."""

    protocol: str
    attack: str
    defence: str
    declared: str  # what the attack says that this defence makes of it
    runs: int
    harm: float | None  # median
    harm_worst: float | None
    harm_undefended: float | None  # median of the same with defence none
    harm_unit: str
    bites_from: float  # from so much on, the attack calls it a bite
    deviated: int  # liars that did what no honest robot would
    stopped: int  # of these
    stop_median_s: float | None  # from the first deviation to Safe Mode, of a run's slowest
    stop_worst_s: float | None
    bound_s: float | None
    correct_stopped: int  # robots, all runs
    cost_bytes_per_s: float | None  # that a robot's audits send
    misses: int  # runs in which something promised was not kept
    missed: str  # what, and in how many


def lines(rows: Iterable[Mapping[str, Any]]) -> list[Line]:
    """The table of a store's rows; of two of the same seed, the later one counts: its attack was changed since."""
    newest = {tuple(row[name] for name in ("protocol", "attack", "defence", "seed")): row for row in rows}
    of: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for (protocol, attack, defence, _), row in newest.items():
        of.setdefault((protocol, attack, defence), []).append(row)
    order = {name: place for place, name in enumerate(ATTACKS)}
    protocols = list(dict.fromkeys(protocol for protocol, _, _ in of))
    points = sorted(
        of, key=lambda at: (protocols.index(at[0]), order.get(at[1], len(order)), at[1], DEFENCES.index(at[2]))
    )
    return [_line(point, of[point], of.get((*point[:2], "none"), [])) for point in points]


def _line(point: tuple[str, str, str], of: list[Mapping[str, Any]], undefended: list[Mapping[str, Any]]) -> Line:
    def values(name: str, rows: list[Mapping[str, Any]] = of) -> list[float]:
        return [row[name] for row in rows if row[name] is not None]

    harms, stops, costs = values("harm"), values("slowest_stop_s"), values("audit_bytes_per_s")
    missed = Counter(words for row in of for words in row["missed"].split("; ") if words)
    protocol, attack, defence = point
    return Line(
        protocol=protocol,
        attack=attack,
        defence=defence,
        declared=of[-1]["declared"],
        runs=len(of),
        harm=median(harms) if harms else None,
        harm_worst=max(harms, default=None),
        harm_undefended=median(values("harm", undefended)) if values("harm", undefended) else None,
        harm_unit=of[-1]["harm_unit"],
        bites_from=of[-1]["bites_from"],
        deviated=sum(row["deviated"] for row in of),
        stopped=sum(row["stopped"] for row in of),
        stop_median_s=median(stops) if stops else None,
        stop_worst_s=max(stops, default=None),
        bound_s=max(values("bound_s"), default=None),
        correct_stopped=sum(row["correct_stopped"] for row in of),
        cost_bytes_per_s=median(costs) if costs else None,
        misses=sum(bool(row["missed"]) for row in of),
        missed="; ".join(f"{words} ({count})" for words, count in missed.items()),
    )


def write_csv(path: Path, table: Iterable[Line]) -> None:
    """The CSV holds the table. Raises: Unavailable: it cannot be written."""
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, [each.name for each in fields(Line)], lineterminator="\n")
    writer.writeheader()
    for line in table:
        cells = asdict(line).items()
        writer.writerow({name: f"{cell:.6g}" if isinstance(cell, float) else cell for name, cell in cells})
    write_whole(path, file.getvalue().encode(), "choose another folder with --out")
