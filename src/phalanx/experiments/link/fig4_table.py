"""The rows of Fig. 4: a CSV that grows a line a packet, and the figures of the paper computed from it.

Only this file reads or writes that CSV (growing_table.py says how). A line without its newline was cut short.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, cast, get_args

from phalanx.errors import UsageError
from phalanx.experiments.growing_table import ELSEWHERE, GrowingTable, read_growing_table

Kind = Literal["plain", "sealed"]
Outcome = Literal["back", "lost", "late", "cut"]
KINDS: tuple[Kind, ...] = get_args(Kind)
MARK = "# phalanx link-fig4 "
COLUMNS = "seq,kind,sent_at_s,outcome,latency_ms"
SLOW_MS = 200.0  # the paper's limit


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where rows come from. All but the version must agree for two runs to share a file.

    Args:
        broker: mosquitto or amqtt for an embedded one, else its URL; never a login.
        interval_s: between two packets of one kind.
        lost_after_s: a packet not back by then is lost.
        version: of the program that began the file, with its commit if known.
    """

    broker: str
    interval_s: float
    lost_after_s: float
    version: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """What became of one packet.

    Args:
        seq: counts up from 0, for each kind.
        kind: plain or sealed.
        sent_at_s: seconds since 1970.
        outcome: back in time; lost; late, back after it had been counted as lost; or cut, under way when we stopped.
        latency_ms: from before sealing to after opening, by a monotonic clock; None unless it came back.
    """

    seq: int
    kind: Kind
    sent_at_s: float
    outcome: Outcome
    latency_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """A CSV's origin and rows: one row a packet, by kind and in the order of sequence numbers."""

    origin: Origin
    rows: dict[Kind, tuple[Row, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The figures of Qrkey §V, for one kind of packet.

    Args:
        sent: packets published.
        undecided: of these, under way when the measurement was interrupted; not counted below.
        lost: not back in time.
        late: of the lost, those that came back after all.
        mean_ms: over every packet that came back, however late; None if none did. The median, 99th percentile and
            largest latency likewise.
        slow_pct: share of packets above 200 ms, the lost among them; None if there are no packets.
        longest_slow_run: most packets in a row above 200 ms, the lost among them.
    """

    sent: int
    undecided: int
    lost: int
    late: int
    reliability_pct: float | None
    mean_ms: float | None
    median_ms: float | None
    p99_ms: float | None
    max_ms: float | None
    slow_pct: float | None
    longest_slow_run: int


def summarize(rows: Sequence[Row]) -> Summary:
    """The figures for the rows of one kind, in the order of sequence numbers.

    Source: Qrkey §V. What it leaves open is decided against us: a lost packet counts as above 200 ms, in the share
    and in a run, and a late one enters the mean.
    """
    sent = rows[-1].seq + 1 if rows else 0
    decided = [row for row in rows if row.outcome != "cut"]
    lost = [row for row in decided if row.outcome != "back"]
    latencies = sorted(row.latency_ms for row in decided if row.latency_ms is not None)
    return Summary(
        sent=sent,
        undecided=sent - len(decided),
        lost=len(lost),
        late=sum(row.outcome == "late" for row in lost),
        reliability_pct=_percent(len(decided) - len(lost), len(decided)),
        mean_ms=statistics.fmean(latencies) if latencies else None,
        median_ms=quantile(latencies, 0.5),
        p99_ms=quantile(latencies, 0.99),
        max_ms=latencies[-1] if latencies else None,
        slow_pct=_percent(sum(map(is_slow, decided)), len(decided)),
        longest_slow_run=_longest_slow_run(decided),
    )


def is_slow(row: Row) -> bool:
    """Whether a packet took more than 200 ms, or never came."""
    return row.latency_ms is None or row.latency_ms > SLOW_MS


def quantile(ordered: Sequence[float], share: float) -> float | None:
    """The smallest value that `share` of all values do not exceed; None if there are none."""
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else None


def _percent(part: int, whole: int) -> float | None:
    return 100 * part / whole if whole else None


def _longest_slow_run(decided: Iterable[Row]) -> int:
    longest = run = 0
    before = -1
    for row in decided:
        # A packet of which we know nothing ends a run: it may have been fast.
        run = (run if row.seq == before + 1 else 0) + 1 if is_slow(row) else 0
        before = row.seq
        longest = max(longest, run)
    return longest


def read_table(path: Path) -> Table:
    """The table in a CSV.

    Raises: UsageError: no such file, or not one of ours. Unavailable: it cannot be read.
    """
    return _parse(path, read_growing_table(path))


class RowFile(GrowingTable):
    """The CSV while it grows, by rows.

    Args:
        path: made if it is not there, with its folder.
        origin: where the rows will come from.
    """

    def __init__(self, path: Path, origin: Origin) -> None:
        super().__init__(path, f"{MARK}{json.dumps(asdict(origin))}\n{COLUMNS}\n")
        self.next_seq: dict[Kind, int] = dict.fromkeys(KINDS, 0)
        self._origin = origin

    def append(self, row: Row) -> None:
        """Write a row, now."""
        latency = "" if row.latency_ms is None else f"{row.latency_ms:.3f}"
        self._write(f"{row.seq},{row.kind},{row.sent_at_s:.3f},{row.outcome},{latency}\n")

    def _whole(self, data: bytes) -> int:
        table = _parse(self.path, data)
        for name in ("broker", "interval_s", "lost_after_s"):
            theirs, ours = getattr(table.origin, name), getattr(self._origin, name)
            if theirs != ours:
                raise UsageError(f"{self.path} was measured with {name} {theirs}, this run has {ours}", ELSEWHERE)
        for kind, rows in table.rows.items():
            self.next_seq[kind] = rows[-1].seq + 1 if rows else 0
        return data.rfind(b"\n") + 1


def _parse(path: Path, data: bytes) -> Table:
    lines = _whole_lines(path, data)
    origin = _parse_origin(path, next(lines, (1, ""))[1])
    packets: dict[Kind, dict[int, Row]] = {kind: {} for kind in KINDS}
    if next(lines, (2, ""))[1] != COLUMNS:
        raise UsageError(f"{path} has other columns", ELSEWHERE)
    for number, line in lines:
        try:
            row = _parse_row(line)
        except ValueError as error:
            raise UsageError(f"line {number} of {path} is not a packet", ELSEWHERE) from error
        # A late packet has two rows: first lost, then late.
        packets[row.kind][row.seq] = row
    return Table(origin, {kind: tuple(rows[seq] for seq in sorted(rows)) for kind, rows in packets.items()})


def _whole_lines(path: Path, data: bytes) -> Iterator[tuple[int, str]]:
    try:
        text = data[: data.rfind(b"\n") + 1].decode()
    except UnicodeDecodeError as error:
        raise UsageError(f"{path} is not a CSV of link-fig4", ELSEWHERE) from error
    return enumerate(text.splitlines(), start=1)


def _parse_origin(path: Path, line: str) -> Origin:
    try:
        if not line.startswith(MARK):
            raise ValueError
        words = json.loads(line.removeprefix(MARK))
        return Origin(
            broker=str(words["broker"]),
            interval_s=float(words["interval_s"]),
            lost_after_s=float(words["lost_after_s"]),
            version=str(words["version"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} is not a CSV of link-fig4", ELSEWHERE) from error


def _parse_row(line: str) -> Row:
    seq, kind, sent_at_s, outcome, latency_ms = line.split(",")
    latency = float(latency_ms) if latency_ms else None
    came_back = latency is not None and latency >= 0
    if kind not in KINDS or outcome not in get_args(Outcome) or came_back is not (outcome in ("back", "late")):
        raise ValueError(line)
    return Row(int(seq), kind, float(sent_at_s), cast("Outcome", outcome), latency)
