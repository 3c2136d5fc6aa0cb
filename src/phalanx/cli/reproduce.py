"""`phalanx reproduce`: the papers' figures, ours beside theirs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from phalanx.experiments.link.fig4 import CSV_NAME, PAPER, Config, measure
from phalanx.experiments.link.fig4_plot import draw
from phalanx.experiments.link.fig4_table import KINDS, read_table, summarize

from .commands.runs import tell_of_compiling
from .login import read_login
from .options import login_option
from .reproduce_bti import bti_fig8_command, bti_fig9_command
from .reproduce_mission import MISSION_COMMANDS
from .run import run
from .terminal import Progress, end_status_line, print_json, stopped, warn_if_nothing_is_drawn

METRICS = {
    "sent": ("packets sent", "d"),
    "lost": ("lost", "d"),
    "late": ("  of these, back too late", "d"),
    "undecided": ("under way when interrupted", "d"),
    "reliability_pct": ("reliability, %", ".4f"),
    "mean_ms": ("mean latency, ms", ".2f"),
    "median_ms": ("median, ms", ".2f"),
    "p99_ms": ("99th percentile, ms", ".2f"),
    "max_ms": ("largest, ms", ".2f"),
    "slow_pct": ("above 200 ms, %", ".3f"),
    "longest_slow_run": ("longest run above 200 ms", "d"),
}


@click.group(epilog="Example: phalanx reproduce link-fig4 --duration 600")
def reproduce() -> None:
    """Measure a figure of one of the papers and draw ours beside it."""
    tell_of_compiling()


reproduce.add_command(bti_fig8_command)
reproduce.add_command(bti_fig9_command)
for command in MISSION_COMMANDS:
    reproduce.add_command(command)


@reproduce.command(
    epilog="Example: phalanx reproduce link-fig4 --broker mqtts://broker.hivemq.com:8883 --duration 54000 (the paper's)"
)
@click.option(
    "--broker", default="auto", show_default=True, help="auto, mosquitto, amqtt, or a mqtt(s):// or ws(s):// URL."
)
@login_option
@click.option(
    "--duration",
    type=click.FloatRange(1, 30 * 86400),
    default=60.0,
    show_default=True,
    help="Seconds to measure for, earlier runs into the same folder included; the paper's is 54000.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out"),
    show_default=True,
    help="Folder for the CSV and the figure.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def link_fig4(broker: str, broker_login: Path | None, duration: float, out: Path, as_json: bool) -> int:
    """Packets lost and late through a broker, plain and sealed (Qrkey Fig. 4).

    Ctrl-C stops; the same command goes on from there, and only draws again when all packets are there.
    """
    config = Config(duration_s=duration)
    login = read_login(broker_login)
    warn_if_nothing_is_drawn()
    csv = out / CSV_NAME
    progress = _progress()

    async def job() -> None:
        await measure(out, config, broker, login, progress)

    if not run(job()):
        stopped("what was measured is", csv)
        return 1
    end_status_line()
    _show(csv, as_json)
    for path in draw(csv):
        click.echo(f"drawn: {path}", err=True)
    return 0


def _progress() -> Callable[[int, int], None]:
    progress = Progress()
    return lambda done, of: progress.tell(f"{done} of {of} packets of each kind", done / of)


def _show(csv: Path, as_json: bool) -> None:
    table = read_table(csv)
    ours = {kind: asdict(summarize(table.rows[kind])) for kind in KINDS}
    paper = {**PAPER, "reliability_pct": 100.0}
    rows: list[dict[str, Any]] = [
        {"metric": metric, "paper": paper.get(metric), **{kind: ours[kind][metric] for kind in KINDS}}
        for metric in METRICS
    ]
    if as_json:
        print_json({"rows": rows, "csv": str(csv), "broker": table.origin.broker, "version": table.origin.version})
        return
    click.echo(f"{'':28}{'paper':>10}{'plain':>10}{'sealed':>10}")
    for row in rows:
        words, form = METRICS[row["metric"]]
        cells = ("-" if row[who] is None else format(row[who], form) for who in ("paper", *KINDS))
        click.echo(f"{words:28}" + "".join(f"{cell:>10}" for cell in cells))
