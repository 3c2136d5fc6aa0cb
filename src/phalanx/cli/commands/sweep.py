"""`phalanx sweep`: many runs, on many processors."""

from __future__ import annotations

import click

from phalanx.cli.complete import offer
from phalanx.cli.options import FILE, OUT_FOLDER, cluster_options, json_option, option, runs


@click.command(
    epilog="Example: phalanx sweep my_sweep.yaml --out out/sweep; docs/guides/sweeps.md says what the file holds"
)
@click.argument("file", metavar="SWEEP.yaml", type=FILE, shell_complete=offer(tuple, ".yaml", ".yml"))
@cluster_options
@option("--out", type=OUT_FOLDER, help="Folder for the rows; without, out/ and the file's name.")
@json_option
@runs("sweep", "sweep")
def sweep() -> None:
    """Run a grid of scenarios under many seeds, on this machine or a cluster, into Parquet.

    Every point is run under every seed, and each run is a row. What is there already is not run again: after Ctrl-C, a
    crash or more seeds, the same command goes on. Ends with 1 if it was stopped, or a run failed.
    """
