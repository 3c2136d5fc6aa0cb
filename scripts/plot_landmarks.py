"""Draw the landmarks of a floor plan or of scans, for a person to check.

    python scripts/plot_landmarks.py MAP OUT.png             a built-in map, or a YAML file
    python scripts/plot_landmarks.py SCANS.npz OUT.png       six of the scans, and the counts over time
    python scripts/plot_landmarks.py SCAN.csv OUT.png        one scan, a beam a line: angle, range

Walls blue (grey: nobody sees them), convex corners green, concave ones orange, jambs red, doorways red squares, rooms
purple stars, QR codes black diamonds.
"""

from __future__ import annotations

import sys

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from phalanx.config.lidar import ExtractionConfig
from phalanx.mission.landmarks import Features, FloorPlan, LaserScan, extract, landmarks_of
from phalanx.world.building.floorplan import load_floorplan

MARKS = {"doorway": "rs", "corner_convex": "g.", "concave_left": "y<", "concave_right": "y>", "room": "m*", "qr": "kD"}
REAL_DOORS = ExtractionConfig(door_min_m=0.7)


def draw_plan(axes: Axes, plan: FloorPlan) -> None:
    """Draw a floor plan with its landmarks and all their aliases."""
    for x, y, x2, y2 in plan.walls:
        axes.plot([x, x2], [y, y2], "-", color="0.7", lw=1)
    for outline in plan.outlines:
        closed = np.vstack([outline.points, outline.points[:1]])
        for i in np.flatnonzero(outline.seen):
            axes.plot(*closed[i : i + 2].T, "-", color="tab:blue", lw=1)
    for site in landmarks_of(plan, REAL_DOORS):
        for alias in site.aliases:
            axes.plot(alias.x_m, alias.y_m, MARKS[alias.type], ms=5)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=plan.name)


def draw_scan(axes: Axes, scan: LaserScan, seen: Features) -> None:
    """Draw a scan with its features."""
    cosines, sines = scan.beams
    axes.plot(scan.ranges_m * cosines, scan.ranges_m * sines, ".", color="0.6", ms=2)
    for wall in seen.walls:
        axes.plot(wall[[4, 6]], wall[[5, 7]], "-", color="tab:blue")
    for corner, jamb in zip(seen.corners, seen.is_jamb, strict=True):
        axes.plot(*corner[:2], "go" if corner[5] else ("r^" if jamb else "y^"), ms=6)
    axes.plot(*seen.doorways[:, :2].T, "rs", ms=7)
    axes.plot(*seen.rooms[:, :2].T, "m*", ms=12)
    axes.plot(0, 0, "k+")
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


def scan_of_csv(path: str) -> LaserScan:
    """Return a scan of one turn from beams at uneven angles, each moved to the nearest evenly spaced one."""
    rows = np.loadtxt(path, delimiter=",", ndmin=2)
    step_rad = 2 * np.pi / len(rows)
    ranges = np.full(len(rows), np.nan)
    ranges[np.round(rows[:, 0] / step_rad).astype(int) % len(rows)] = rows[:, 1]
    return LaserScan(ranges, 0.0, step_rad)


def main() -> None:
    """Draw the file that the command line names."""
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    source, out = sys.argv[1:]
    if source.endswith(".csv"):
        figure, axes = plt.subplots(figsize=(14, 14))
        scan = scan_of_csv(source)
        draw_scan(axes, scan, extract(scan, REAL_DOORS))
        axes.set(title=source)
    elif not source.endswith(".npz"):
        figure, axes = plt.subplots(figsize=(14, 14))
        draw_plan(axes, load_floorplan(source))
    else:
        data = np.load(source)
        limits = [float(data[name]) for name in ("angle_min_rad", "angle_increment_rad", "range_min_m", "range_max_m")]
        scans = [LaserScan(ranges, *limits) for ranges in data["ranges_m"]]
        features = [extract(scan, REAL_DOORS) for scan in scans]
        figure, grid = plt.subplots(2, 4, figsize=(24, 12))
        for axes, i in zip(grid.ravel(), np.linspace(0, len(scans) - 1, 6).astype(int), strict=False):
            draw_scan(axes, scans[i], features[i])
            axes.set(title=f"scan {i}")
        grid[1, 2].plot([len(seen.walls) for seen in features], color="tab:blue", label="walls")
        grid[1, 3].plot([int(seen.corners[:, 5].sum()) for seen in features], "g-", label="convex")
        grid[1, 3].plot([int((seen.corners[:, 5] == 0).sum()) for seen in features], "y-", label="concave")
        grid[1, 3].plot([len(seen.doorways) for seen in features], "r-", label="doorways")
        for axes in grid[1, 2:]:
            axes.set(xlabel="scan", ylabel="count")
            axes.legend()
    figure.savefig(out, dpi=60, bbox_inches="tight")


if __name__ == "__main__":
    main()
