"""The papers' parameters: frozen, units in names, checked when made; one file a subject."""

from .bti import BtiConfig
from .flock import Box, Disc, FlockConfig, WheelsConfig
from .link import LinkConfig
from .radio import RadioConfig

__all__ = ["Box", "BtiConfig", "Disc", "FlockConfig", "LinkConfig", "RadioConfig", "WheelsConfig"]
