"""A world of arrays and ticks."""

from .dotbots import Dotbots

__all__ = ["Dotbots"]
