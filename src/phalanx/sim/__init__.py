"""A world of arrays and ticks."""

from .swarms.dotbots import Dotbots

__all__ = ["Dotbots"]
