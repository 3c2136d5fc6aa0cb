"""The papers' parameters: frozen, units in names, checked when made; one file a subject."""

from .bti import BtiConfig
from .flock import Box, Disc, FlockConfig
from .link import LinkConfig
from .radio import RadioConfig
from .wheels import WheelsConfig

__all__ = ["Box", "BtiConfig", "Disc", "FlockConfig", "LinkConfig", "RadioConfig", "WheelsConfig"]
