"""Phalanx keeps robot swarms in honest hands: who may command, what may be done, what is really done."""

__version__ = "0.1.0"

__all__ = ["__version__"]
