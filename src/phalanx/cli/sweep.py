"""`phalanx sweep`: make the missing runs, and print the results of each point of the grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from phalanx.lab.sweep.dealing import run_sweep
from phalanx.lab.sweep.plan import Plan, read_sweep
from phalanx.lab.sweep.store import OUTCOME, Store, points
from phalanx.papers.table import version

from .sim import format_number
from .terminal import Progress, end_status_line, print_json, print_table, stdout_to_stderr, talk

MOST_FAILURES = 10  # printed one by one


def sweep(file: Path, scheduler: str | None, workers: int | None, out: Path | None, as_json: bool) -> int:
    """Run a sweep. Return 1 if interrupted, or if a run failed."""
    chosen = read_sweep(file)
    store, failed, stopped = make_runs(chosen, out or Path("out") / file.stem, scheduler, workers)
    if stopped:
        return 1
    rows = points(chosen, store.rows())
    if as_json:
        print_json({"points": rows, "failed": failed, "rows": str(store.runs)})
    else:
        _show(rows, [name for name, values in chosen.axes.items() if len(values) > 1])
        talk(f"rows: {store.runs}")
    return 1 if failed else 0


def make_runs(
    plan: Plan,
    out: Path,
    scheduler: str | None,
    workers: int | None,
    columns: Mapping[str, str] = OUTCOME,
    run: Callable[[Any], dict[str, Any]] | None = None,  # returns a job's row; None: as for sweeps
) -> tuple[Store, list[str], bool]:
    """Return all runs, the failures, and whether Ctrl-C interrupted them. Raises: UsageError, Unavailable."""
    progress, failed, stopped = Progress(), list[str](), False

    def show_progress(done: int, of: int) -> None:
        progress.tell(f"{done} of {of} runs", done / of)

    with Store(out, plan, version(), columns) as store:
        try:
            with stdout_to_stderr():
                failed = run_sweep(plan, store, scheduler, workers, show_progress, run=run)
        except KeyboardInterrupt:
            stopped = True
        end_status_line()
    for line in failed[:MOST_FAILURES]:
        talk(f"failed: {line}")
    if len(failed) > MOST_FAILURES:
        talk(f"failed: {len(failed) - MOST_FAILURES} more")
    if stopped:
        talk(f"stopped: {len(store.done)} runs are in {store.runs}; run the same command again to continue")
    return store, failed, stopped


def _show(rows: list[dict[str, Any]], varied: list[str]) -> None:
    heads = [*varied, "runs", "stopped", "never", "slowest s", "correct stopped", "no quorum", "contacts"]
    scored = any(row["score"] is not None for row in rows)
    heads += ["score"] * scored
    lines = [
        [
            *(str(row[name]) for name in varied),
            str(row["runs"]),
            f"{row['liars_stopped']} of {row['liars']}",
            str(row["liars_never_stopped"]),
            format_number(row["slowest_stop_s"], ".2f"),
            str(row["correct_in_safe_mode"]),
            str(row["without_quorum"]),
            str(row["contacts"]),
            *[format_number(row["score"], ".1f")] * scored,
        ]
        for row in rows
    ]
    print_table(heads, lines)
