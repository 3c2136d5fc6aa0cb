"""`phalanx attack scorecard`: every attack, every defence, every protocol, through the machinery of sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from phalanx.errors import UsageError
from phalanx.experiments.scorecard.bout import OUTCOME, prepare, run_bout
from phalanx.experiments.scorecard.card import Line, lines, write_csv
from phalanx.experiments.scorecard.picture import draw_card
from phalanx.experiments.scorecard.plan import Card, absolute
from phalanx.experiments.sweep.cluster import run_sweep
from phalanx.experiments.sweep.store import Store
from phalanx.experiments.version import version

from .commands.runs import tell_of_compiling
from .sim import told
from .sweep import tell_failed
from .terminal import Progress, end_status_line, print_json, print_table, said_aside, talk, warn_if_nothing_is_drawn

NAME = "scorecard.csv"
HEADS = (
    *("protocol", "attack", "defence", "declared", "runs", "harm", "worst", "undefended", ""),
    *("stopped s", "worst s", "bound s", "correct stopped", "cost B/s", "missed"),
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
    """Makes the runs that are not there, and the table of all; 1 if it was stopped, a run failed, or `bound` missed."""
    if scheduler and workers:
        raise UsageError("--workers with --scheduler", "a scheduler has workers of its own")
    with said_aside():
        card = Card(tuple(map(absolute, attacks)), tuple(map(absolute, controllers)), seeds)
    warn_if_nothing_is_drawn()
    tell_of_compiling()
    progress, stopped, failed = Progress(), False, list[str]()

    def tell(done: int, of: int) -> None:
        progress.tell(f"{done} of {of} runs", done / of)

    with Store(out, card, version(), OUTCOME) as store:
        try:
            with said_aside():
                failed = run_sweep(card, store, scheduler, workers, tell, run=run_bout, prepare=prepare)
        except KeyboardInterrupt:
            stopped = True
        end_status_line()
        store.write()
        table = lines(store.rows())
    write_csv(out / NAME, table)
    if as_json:
        print_json({"lines": [asdict(line) for line in table], "failed": failed, "csv": str(out / NAME)})
    else:
        _show(table)
    tell_failed(failed)
    if stopped:
        talk(f"stopped: {len(store.done)} runs are in {store.runs}; the same command goes on")
        return 1
    for path in draw_card(out, table, version()):
        talk(f"drawn: {path}")
    return int(bool(failed) or any(line.misses for line in table if line.defence == "bound"))


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
                *(told(value, ".3g") for value in (line.harm, line.harm_worst, line.harm_undefended)),
                line.harm_unit,
                *(told(value, ".2f") for value in (line.stop_median_s, line.stop_worst_s, line.bound_s)),
                str(line.correct_stopped),
                told(line.cost_bytes_per_s, ".0f"),
                line.missed or "-",
            )
            for line in table
        ],
    )
