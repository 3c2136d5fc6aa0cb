"""`phalanx reproduce`: the papers' figures, ours beside theirs."""

from __future__ import annotations

import click


@click.group(epilog="Example: phalanx reproduce link-fig4 --duration 600")
def reproduce() -> None:
    """Measure a figure of one of the papers and draw ours beside it."""
