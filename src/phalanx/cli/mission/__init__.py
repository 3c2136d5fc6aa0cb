"""`phalanx mission`: encode, inspect, run, draw, audit and crack missions."""

from .commands import mission

__all__ = ["mission"]
