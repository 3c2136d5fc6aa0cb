"""The packets of Fig. 4: one line each in the table; the paper's metrics computed from them, and the comparison."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, cast, get_args

from phalanx.errors import UsageError
from phalanx.papers.statement import Report, Statement
from phalanx.papers.table import OTHER_FOLDER_HINT, Table

Kind = Literal["plain", "sealed"]
Outcome = Literal["back", "lost", "late", "cut"]
KINDS: tuple[Kind, ...] = get_args(Kind)
COLUMNS = ("seq", "kind", "sent_at_s", "outcome", "latency_ms")
SLOW_MS = 200.0  # the paper's limit
# The paper's results, Qrkey §V: one kind of packet, through HiveMQ's public broker, for 15 h.
PAPER = {"sent": 108_471, "lost": 0, "mean_ms": 21.55, "slow_pct": 1.194, "longest_slow_run": 70}


@dataclass(frozen=True, slots=True)
class Row:
    """Outcome of one packet."""

    seq: int  # counts up from 0, for each kind
    kind: Kind
    sent_at_s: float  # seconds since 1970
    # back: in time. lost: not back in time. late: back after it was counted as lost. cut: pending when the run ended.
    outcome: Outcome
    # Monotonic time from before sealing to after opening; None unless the packet came back.
    latency_ms: float | None = None


Packets = dict[Kind, tuple[Row, ...]]


def head(*, broker: str, interval_s: float, lost_after_s: float, version: str) -> Table:
    """Return an empty table with the origin of this measurement.

    Another version of the program may continue it, because the broker and the network are what is measured.
    `broker` is `mosquitto` for a broker that we start, else its URL; never a login.
    """
    origin = {"broker": broker, "interval_s": interval_s, "lost_after_s": lost_after_s, "version": version}
    return Table("link-fig4", origin, COLUMNS, by_line=True, free=frozenset({"version"}))


def cells(row: Row) -> tuple[str, ...]:
    """Return the cells of a packet's line in the CSV."""
    latency = "" if row.latency_ms is None else f"{row.latency_ms:.3f}"
    return str(row.seq), row.kind, f"{row.sent_at_s:.3f}", row.outcome, latency


def packets(table: Table) -> Packets:
    """Return the packets by kind, in order of sequence number, one row each.

    A late packet has two lines, first lost, then late; the second replaces the first.
    Raises: UsageError: a line is not a packet, or the head lacks part of the origin.
    """
    found: dict[Kind, dict[int, Row]] = {kind: {} for kind in KINDS}
    if table.columns != COLUMNS or {"broker", "interval_s", "lost_after_s"} - table.origin.keys():
        raise UsageError(f"{table.figure} was measured otherwise: other columns, or another origin", OTHER_FOLDER_HINT)
    for number, line in table.lines:
        try:
            row = _parse_row(line)
        except ValueError as error:
            raise UsageError(f"line {number} of {table.figure}.csv is not a packet", OTHER_FOLDER_HINT) from error
        found[row.kind][row.seq] = row
    return {kind: tuple(rows[seq] for seq in sorted(rows)) for kind, rows in found.items()}


def _shown(words: str, form: str) -> dict[str, str]:
    """Return the metadata of a metric: its label and number format."""
    return {"words": words, "form": form}


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Metrics of Qrkey §V for one kind of packet; None where no packet has the value."""

    sent: int = field(metadata=_shown("packets sent", "d"))
    lost: int = field(metadata=_shown("lost", "d"))
    late: int = field(metadata=_shown("  of these, back too late", "d"))
    undecided: int = field(metadata=_shown("under way when interrupted", "d"))  # excluded from all metrics below
    reliability_pct: float | None = field(metadata=_shown("reliability, %", ".4f"))
    # These four include every packet that came back, however late.
    mean_ms: float | None = field(metadata=_shown("mean latency, ms", ".2f"))
    median_ms: float | None = field(metadata=_shown("median, ms", ".2f"))
    p99_ms: float | None = field(metadata=_shown("99th percentile, ms", ".2f"))
    max_ms: float | None = field(metadata=_shown("largest, ms", ".2f"))
    # These two count lost packets as slow.
    slow_pct: float | None = field(metadata=_shown("above 200 ms, %", ".3f"))
    longest_slow_run: int = field(metadata=_shown("longest run above 200 ms", "d"))


def summarize(rows: Sequence[Row]) -> Summary:
    """Compute the metrics for the rows of one kind, in order of sequence numbers.

    Source: Qrkey §V. Where it is ambiguous we choose the worse value for us: a lost packet counts as above 200 ms,
    in the share and in a run, and a late one enters the mean.
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
        median_ms=statistics.median(latencies) if latencies else None,
        p99_ms=quantile(latencies, 0.99),
        max_ms=latencies[-1] if latencies else None,
        slow_pct=_percent(sum(map(is_slow, decided)), len(decided)),
        longest_slow_run=_longest_slow_run(decided),
    )


def report(table: Table) -> Report:
    """Report the paper's metrics, and ours for each kind of packet."""
    ours = {kind: asdict(summarize(rows)) for kind, rows in packets(table).items()}
    paper = {**PAPER, "reliability_pct": 100.0}
    rows: list[dict[str, Any]] = []
    lines = [f"{'':28}" + "".join(f"{title:>10}" for title in ("paper", *KINDS))]
    for each in fields(Summary):
        row: dict[str, Any] = {"paper": paper.get(each.name), **{kind: ours[kind][each.name] for kind in KINDS}}
        rows.append({"metric": each.name, **row})
        texts = ("-" if value is None else format(value, each.metadata["form"]) for value in row.values())
        lines.append(f"{each.metadata['words']:28}" + "".join(f"{cell:>10}" for cell in texts))
    return Report(rows, lines, {"broker": table.origin["broker"]})


def compare(table: Table) -> list[Statement]:
    """Compare our measurements with the statements about Fig. 4 in Qrkey §V."""
    ours = [summarize(rows) for rows in packets(table).values()]
    broker = table.origin["broker"]

    def values_text(name: str, form: str) -> str:
        values = [getattr(each, name) for each in ours]
        return "; ".join("-" if value is None else format(value, form) for value in values)

    return [
        Statement(
            what="packets lost, plain; sealed",
            paper=f"{PAPER['lost']} of {PAPER['sent']}",
            ours=f"{values_text('lost', 'd')} of {values_text('sent', 'd')}",
            agrees=all(each.lost == 0 for each in ours),
            asked="not worse",
            why="none",
        ),
        *(
            Statement(
                what=f"{label}, plain; sealed",
                paper=f"{PAPER[name]:g}",
                ours=values_text(name, form),
                agrees=all((getattr(each, name) or 0) <= PAPER[name] for each in ours),
                asked="not worse",
                why=f"no more than the paper's, through HiveMQ's public broker; ours through {broker}",
            )
            for name, label, form in (("mean_ms", "mean latency, ms", ".2f"), ("slow_pct", "above 200 ms, %", ".3f"))
        ),
    ]


def is_slow(row: Row) -> bool:
    """Return whether a packet took more than 200 ms or was lost."""
    return row.latency_ms is None or row.latency_ms > SLOW_MS


def quantile(ordered: Sequence[float], share: float) -> float | None:
    """Return the smallest value that at least `share` of all values do not exceed; None if there are none."""
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else None


def _percent(part: int, whole: int) -> float | None:
    return 100 * part / whole if whole else None


def _longest_slow_run(decided: Iterable[Row]) -> int:
    longest = run = 0
    before = -1
    for row in decided:
        # A packet of unknown outcome ends a run: it may have been fast.
        run = (run if row.seq == before + 1 else 0) + 1 if is_slow(row) else 0
        before = row.seq
        longest = max(longest, run)
    return longest


def _parse_row(line: list[str]) -> Row:
    seq, kind, sent_at_s, outcome, latency_ms = line
    latency = float(latency_ms) if latency_ms else None
    came_back = latency is not None and latency >= 0
    if kind not in KINDS or outcome not in get_args(Outcome) or came_back is not (outcome in ("back", "late")):
        raise ValueError(kind)
    return Row(int(seq), kind, float(sent_at_s), cast("Outcome", outcome), latency)
