"""`phalanx sweep`: run a grid of scenarios on many processors."""

from __future__ import annotations

import click

from phalanx.cli.complete import offer
from phalanx.cli.options import FILE, OUT_FOLDER, cluster_options, implemented_by, json_option, option


@click.command(
    epilog="Example: phalanx sweep my_sweep.yaml --out out/sweep; phalanx docs guides/sweeps describes the file"
)
@click.argument("file", metavar="SWEEP.yaml", type=FILE, shell_complete=offer(tuple, ".yaml", ".yml"))
@cluster_options
@option("--out", type=OUT_FOLDER, help="Folder for the results. Default: out/ plus the file's name.")
@json_option
@implemented_by("sweep", "sweep")
def sweep() -> None:
    """Run a grid of scenarios with many seeds, locally or on a cluster, and write Parquet files.

    Each run, a point of the grid with a seed, is a row. Existing runs are not repeated: after Ctrl-C, a crash or more
    seeds, the same command continues. Exit with 1 if interrupted, or if a run failed.
    """
