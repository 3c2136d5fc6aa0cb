"""Extract landmarks from lidar scans, camera images and floor plans."""

from .features import Features, extract
from .floorplan import FloorPlan, WallCode, floorplan_of_yaml
from .gridmap import floorplan_of_map
from .scan import LaserScan
from .sites import Site, landmarks_of, look_alikes_of

__all__ = [
    "Features",
    "FloorPlan",
    "LaserScan",
    "Site",
    "WallCode",
    "extract",
    "floorplan_of_map",
    "floorplan_of_yaml",
    "landmarks_of",
    "look_alikes_of",
]
