"""Parameters of the papers, as frozen dataclasses: units are in the names, and values are checked on construction."""

from .bti import BtiConfig
from .flock import Box, Disc, FlockConfig, WheelsConfig
from .link import LinkConfig
from .radio import RadioConfig

__all__ = ["Box", "BtiConfig", "Disc", "FlockConfig", "LinkConfig", "RadioConfig", "WheelsConfig"]
