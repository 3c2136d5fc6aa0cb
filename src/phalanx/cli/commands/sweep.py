"""`phalanx sweep`: many runs, on many processors."""

from __future__ import annotations

import click

from phalanx.cli.complete import offer
from phalanx.cli.options import FILE, OUT_FOLDER, cluster_options, json_option, option, runs


@click.command(
    epilog="Example: phalanx sweep my_sweep.yaml --out out/sweep; phalanx docs guides/sweeps says what the file holds"
)
@click.argument("file", metavar="SWEEP.yaml", type=FILE, shell_complete=offer(tuple, ".yaml", ".yml"))
@cluster_options
@option("--out", type=OUT_FOLDER, help="Folder for the results. Default: out/ and the file's name.")
@json_option
@runs("sweep", "sweep")
def sweep() -> None:
    """Run a grid of scenarios with many seeds, here or on a cluster, and write Parquet files.

    Each run, a point of the grid with a seed, is a row. Runs that are there already are not repeated: after Ctrl-C, a
    crash or more seeds, the same command continues. Ends with 1 if it was stopped, or a run failed.
    """
