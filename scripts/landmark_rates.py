"""Measure how often, and how exactly, a single scan shows each kind of landmark of a floor plan from random poses.

    python scripts/landmark_rates.py [MAP] [POSES] [DELTA_M] [NOISE_M]

Numbers in docs/adr/0019 come from here (office_40x40, 2000 poses, 0.1 m).
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict

import numpy as np

from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.mission.landmarks import FloorPlan, extract, landmarks_of
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.observable import Landmark
from phalanx.world.building.floorplan import load_floorplan

NEAR_M = 10.0  # visible: this near, not flatter than this, wholly in the field of view
FLAT_RAD = math.radians(20)


def same(seen: Landmark, alias: Landmark) -> bool:
    """Return whether an observation matches this landmark: within 0.3 m, half a 15-degree bin, a tenth of the area."""
    if seen.type != alias.type or math.hypot(seen.x_m - alias.x_m, seen.y_m - alias.y_m) > 0.3:
        return False
    if seen.area_m2 is not None:
        return abs(seen.area_m2 - alias.area_m2) < 0.1 * alias.area_m2
    turn = math.pi if seen.type == "doorway" else 2 * math.pi
    apart = (seen.orientation_rad - alias.orientation_rad + turn / 2) % turn - turn / 2
    return abs(apart) < math.radians(7.5)


def visible(plan: FloorPlan, pose: tuple[float, float, float], door: Landmark, width_m: float, fov_rad: float) -> bool:
    """Return whether both jambs of a doorway are in view."""
    x, y, heading = pose
    along = (math.cos(door.orientation_rad) * width_m / 2, math.sin(door.orientation_rad) * width_m / 2)
    jambs = [(door.x_m + s * along[0], door.y_m + s * along[1]) for s in (-1, 1)]
    to = (door.x_m - x, door.y_m - y)
    away = math.hypot(*to)
    bearings = [math.remainder(math.atan2(b - y, a - x) - heading, 2 * math.pi) for a, b in jambs]
    flat = abs(to[0] * along[1] - to[1] * along[0]) / (away * width_m / 2)
    return (
        away < NEAR_M
        and flat > math.sin(FLAT_RAD)
        and max(map(abs, bearings)) < fov_rad / 2 - 0.05
        and abs(bearings[0] - bearings[1]) < math.pi
        and all(plan.sees((x, y), jamb) for jamb in jambs)
    )


def main() -> None:
    """Print the table."""
    plan = load_floorplan(sys.argv[1] if len(sys.argv) > 1 else "office_40x40")
    poses = int(sys.argv[2]) if len(sys.argv) > 2 else 2000
    delta_m = float(sys.argv[3]) if len(sys.argv) > 3 else 0.1
    lidar_config = LidarConfig(noise_m=float(sys.argv[4]) if len(sys.argv) > 4 else 0.01)
    config, random = ExtractionConfig().for_noise(lidar_config.noise_m), np.random.default_rng(2)
    sites, lidar = landmarks_of(plan, config), Lidar(plan.walls, lidar_config)
    aliases = [alias for site in sites for alias in site.aliases]
    jambs = np.array(
        [
            (site.aliases[0].x_m + s * math.cos(turn), site.aliases[0].y_m + s * math.sin(turn))
            for site in sites
            if site.type == "doorway" and (turn := site.aliases[0].orientation_rad) is not None
            for s in (-site.width_m / 2, site.width_m / 2)
        ]
    ).reshape(-1, 2)
    seen_count, right, errors, in_cell, centred = (defaultdict(list) for _ in range(5))
    shown, expected = 0, 0
    x0, y0, x1, y1 = plan.bounds
    done = 0
    while done < poses:
        x, y, heading = random.uniform(x0, x1), random.uniform(y0, y1), random.uniform(-math.pi, math.pi)
        if plan.clearance_m(x, y) < 0.25 or not plan.inside(x, y):
            continue
        done += 1
        origin = random.uniform(0, delta_m, 2)
        seen = extract(lidar.sweep((x, y, heading), random), config).landmarks(x, y, heading)
        found = set()
        for landmark in seen:
            kind = landmark.type
            match = next((alias for alias in aliases if same(landmark, alias)), None)
            if match is None and kind.startswith("concave"):
                # A jamb whose doorway is not in view is a concave corner, if not a landmark.
                kind = "jamb alone"
                right[kind].append(bool(np.min(np.hypot(*(jambs - [landmark.x_m, landmark.y_m]).T)) < 0.3))
                continue
            right[kind].append(match is not None)
            if match is None:
                continue
            found.add(match)
            error = np.array([landmark.x_m - match.x_m, landmark.y_m - match.y_m])
            errors[kind].append(math.hypot(*error))
            centred[kind].append(bool(np.all(np.abs(error) < delta_m / 2)))
            true = np.array([match.x_m, match.y_m]) - origin
            in_cell[kind].append(bool(np.all(np.rint((true + error) / delta_m) == np.rint(true / delta_m))))
        for site in sites:
            if site.type == "doorway" and visible(
                plan, (x, y, heading), site.aliases[0], site.width_m, lidar_config.fov_rad
            ):
                expected += 1
                shown += site.aliases[0] in found
        seen_count["any"].append(bool(found))
    print(f"{plan.name}: {poses} poses, delta {delta_m} m, noise {lidar_config.noise_m} m")
    print(f"{'type':16}{'seen':>7}{'precision':>11}{'cm p50':>8}{'cm p95':>8}{'in its cell':>13}{'anywhere':>10}")
    for kind in sorted(right):
        p50, p95 = np.percentile(np.array(errors[kind] or [np.nan]) * 100, [50, 95])
        print(
            f"{kind:16}{len(right[kind]):7}{np.mean(right[kind]):11.4f}{p50:8.2f}{p95:8.2f}"
            f"{np.mean(centred[kind] or [np.nan]):13.4f}{np.mean(in_cell[kind] or [np.nan]):10.4f}"
        )
    if expected:
        print(f"doorways in view: {expected}, shown {shown / expected:.4f}")
    print(f"scans with any landmark: {np.mean(seen_count['any']):.4f}")


if __name__ == "__main__":
    main()
