"""`phalanx attack scorecard`: run every attack against every defence in every protocol, as a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from phalanx.lab.scorecard.bout import OUTCOME, run_bout
from phalanx.lab.scorecard.card import Line, draw_card, lines, write_csv
from phalanx.lab.scorecard.plan import absolute, scorecard_plan
from phalanx.papers.table import version

from .sim import format_number
from .sweep import make_runs
from .terminal import print_json, print_table, stdout_to_stderr, talk, warn_if_nothing_is_drawn

NAME = "scorecard.csv"
HEADS = (
    *("protocol", "attack", "defence", "declared", "runs", "harm", "worst", "undefended", ""),
    *("stopped s", "worst s", "bound s", "correct stopped", "cost B/s", "on air %", "missed"),
)


def scorecard(
    attacks: Sequence[str],
    controllers: Sequence[str],
    seeds: int,
    scheduler: str | None,
    workers: int | None,
    out: Path,
    as_json: bool,
) -> int:
    """Make missing runs and the table of all. Return 1 if interrupted, a run failed, or `hardened` broke a promise."""
    with stdout_to_stderr():
        plan = scorecard_plan([*map(absolute, attacks)], [*map(absolute, controllers)], seeds)
    warn_if_nothing_is_drawn()
    store, failed, stopped = make_runs(plan, out, scheduler, workers, OUTCOME, run=run_bout)
    table = lines(store.rows())
    write_csv(out / NAME, table)
    if as_json:
        print_json({"lines": [asdict(line) for line in table], "failed": failed, "csv": str(out / NAME)})
    else:
        _show(table)
    if stopped:
        return 1
    for path in draw_card(out, table, version()):
        talk(f"drawn: {path}")
    return int(bool(failed) or any(line.misses for line in table if line.defence == "hardened"))


def _show(table: Sequence[Line]) -> None:
    print_table(
        HEADS,
        [
            (
                line.protocol,
                line.attack,
                line.defence,
                line.declared,
                str(line.runs),
                *(format_number(value, ".3g") for value in (line.harm, line.harm_worst, line.harm_undefended)),
                line.harm_unit,
                *(format_number(value, ".2f") for value in (line.stop_median_s, line.stop_worst_s, line.bound_s)),
                str(line.correct_stopped),
                format_number(line.cost_bytes_per_s, ".0f"),
                format_number(line.cost_airtime_pct, ".2f"),
                line.missed or "-",
            )
            for line in table
        ],
    )
