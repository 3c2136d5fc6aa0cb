"""`phalanx reproduce`: the papers' figures, ours beside theirs."""

from phalanx.cli.reproduce import reproduce

__all__ = ["reproduce"]
