"""Run missions on logs of real lasers: survey the first part of a log, and replay the rest with its own odometry.

    python scripts/mission_lasers.py LOG... [--surveyed 0.5] [--picture FILE] [--json]

A log is CARMEN's with corrected poses, as those beside https://github.com/acschaefer/ple in data/carmen (gunzip them
first; they are not ours to pass on). After each scan such a log continues from the scan's corrected pose, so that the
motion between scans is the original odometry. Its error is measured in the surveyed part, and given to the robot; so is
the distance of similar landmarks there, as nothing is known about the unsurveyed part.

A fix is judged by `phalanx.world.missions.truth` against the corrected pose. The exit code is 1 if any was false.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from phalanx.config.lidar import ExtractionConfig
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.errors import UsageError
from phalanx.mission import (
    BuildOptions,
    Draft,
    EncodedMission,
    Experience,
    Landmark,
    Mission,
    Position,
    Profile,
    State,
    Walker,
    build,
)
from phalanx.mission.authoring.findable import ALIKE_RAD, alone, mark_lookalikes
from phalanx.mission.landmarks import LaserScan, extract
from phalanx.mission.observable import HALF_TURN_TYPES, number_or_nan
from phalanx.mission.walk.chart import rotation_between
from phalanx.mission.walk.fix import fixed, initial_belief, odometry_errors_of
from phalanx.world.missions.truth import pose_error

Pose = tuple[float, float, float]
KINDS = ("doorway", "corner_convex", "concave_left", "concave_right")
SAME_M, SAME_RAD = 0.2, math.radians(15)
STEADY_M = 0.8  # a landmark of the map was seen from two places so far apart
APART_M = 0.25
AROUND_M = 2.0  # landmarks within this distance are counted
CELL_MM, TOLERANCE_M, TRIES = 400, 4.0, 2_000_000
SURE = 0.6  # of one landmark: repeated sightings have the same error
FAR_M = 20.0  # a scanner's word for a miss is more
SCANNER = ExtractionConfig(door_min_m=0.7, feature_range_m=8.0).for_noise(0.015)
SHORTEST_M = 0.05


@dataclass(frozen=True, slots=True)
class Sample:
    """A scan, its corrected pose, and the odometry since the scan before."""

    pose: Pose
    moved: Pose  # in the frame of the scan before
    scan: LaserScan


@dataclass(slots=True)
class Found:
    """A landmark with all sightings of it."""

    landmark: Landmark
    places: list[tuple[float, float]]  # of the scanner
    off: list[Pose] = field(default_factory=list)  # difference of each sighting from earlier ones: m, m, rad

    @property
    def is_steady(self) -> bool:
        """Return whether it was seen from distant positions: an occlusion edge would move with the robot."""
        return any(math.dist(self.places[0], place) >= STEADY_M for place in self.places)


@dataclass(slots=True)
class Lived:
    """Result of the replayed part of a log."""

    scans: int = 0
    way_m: float = 0.0
    landmarks: int = 0
    decoded: int = 0
    fixes: int = 0
    false: Counter[str] = field(default_factory=Counter)
    not_validated: Counter[str] = field(default_factory=Counter)
    errors_m: list[float] = field(default_factory=list)
    odometry_m: list[float] = field(default_factory=list)
    path: list[tuple[Pose, Pose, Pose]] = field(default_factory=list)  # true, believed, by odometry alone

    def row(self, name: str) -> dict[str, object]:
        """Return the results as a dictionary."""
        half, most = np.quantile(self.errors_m, (0.5, 1.0))
        return {
            "log": name,
            "scans": self.scans,
            "way_m": round(self.way_m),
            "landmarks": self.landmarks,
            "decoded": self.decoded,
            "fixes": self.fixes,
            "false_fixes": sum(self.false.values()),
            "error_m_p50": round(float(half), 2),
            "error_m_max": round(float(most), 2),
            "odometry_m_max": round(max(self.odometry_m), 2),
            "not_validated": dict(self.not_validated),
        }


def seen_from(pose: Pose, other: Pose) -> Pose:
    """Return a pose in the frame of another one."""
    dx, dy, (sine, cosine) = other[0] - pose[0], other[1] - pose[1], (math.sin(pose[2]), math.cos(pose[2]))
    return cosine * dx + sine * dy, cosine * dy - sine * dx, math.remainder(other[2] - pose[2], math.tau)


def after(pose: Pose, step: Pose) -> Pose:
    """Return a pose moved by a step in its own frame."""
    sine, cosine = math.sin(pose[2]), math.cos(pose[2])
    return pose[0] + cosine * step[0] - sine * step[1], pose[1] + sine * step[0] + cosine * step[1], pose[2] + step[2]


def read(path: Path) -> list[Sample]:
    """Return the scans of a log. Raises: SystemExit: it has none, or a line is not CARMEN's."""
    samples: list[Sample] = []
    step, before = (0.0, 0.0, 0.0), None
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        kind, *words = line.split() or [""]
        try:
            if kind == "ODOM":
                here = (float(words[0]), float(words[1]), float(words[2]))
                if before is not None:
                    step = after(step, seen_from(before, here))
                before = here
            elif kind == "FLASER":
                count = int(words[0])
                x, y, heading = map(float, words[count + 1 : count + 4])
                scan = scan_of(np.array(list(map(float, words[1 : count + 1]))))
                samples.append(Sample((x, y, heading), step, scan))
                step, before = (0.0, 0.0, 0.0), None
        except (ValueError, IndexError) as error:
            raise SystemExit(f"error: {path}:{number}: no line of a CARMEN log: {error}") from None
    if len(samples) < 2:
        raise SystemExit(f"error: {path}: {len(samples)} scans\nhint: a log with FLASER lines")
    return samples


def scan_of(ranges_m: np.ndarray) -> LaserScan:
    """Return a scan over half a turn; an odd number of beams has one at either end."""
    count = len(ranges_m)
    step = math.pi / (count - count % 2)
    first = -math.pi / 2 + (0.0 if count % 2 else step / 2)
    return LaserScan(np.where(ranges_m >= FAR_M, np.inf, ranges_m), first, step, SHORTEST_M, FAR_M)


def survey(name: str, samples: list[Sample], start: Pose) -> tuple[Mission, MissionConfig]:
    """Return a mission to find, in any order, the landmarks seen in several scans, and the robot's configuration.

    For each landmark the mission states the distance to the next similar one. For the unsurveyed part, robots use the
    distances of similar landmarks in the surveyed part.
    """
    found: list[Found] = []
    for sample in samples:
        for landmark in extract(sample.scan, SCANNER).landmarks(*sample.pose):
            if landmark.type in KINDS:
                add(found, landmark, sample.pose)
    every = [each.landmark for each in found]
    steady = [each.landmark for each in found if each.is_steady]
    draft = Draft(name, roam=True, coding=CodingConfig(delta_mm=CELL_MM))
    draft.node("start", Position(*start[:2]), start=True)
    before = "start"
    for i, landmark in enumerate(alone(steady, every, APART_M)):
        draft.node(f"landmark{i}", landmark)
        draft.way(before, f"landmark{i}", both=True)
        before = f"landmark{i}"
    if not steady:
        raise UsageError("no landmark was seen from two places")
    off = np.array([row for each in found if each.is_steady for row in each.off])
    config = replace(measured(samples), strangers_per_m2=density(every))
    seen_deg = max(config.sight_deg, math.degrees(float(np.sqrt(np.mean(off[:, 2] ** 2)))))
    return mark_lookalikes(draft.mission(), every), replace(config, sight_deg=seen_deg, sure_deg=seen_deg * SURE)


def density(landmarks: list[Landmark]) -> float:
    """Return how many similar landmarks stand around these, per square metre."""
    count = 0
    for each in landmarks:
        for other in landmarks:
            away_m = math.dist((each.x_m, each.y_m), (other.x_m, other.y_m))
            if SAME_M < away_m < AROUND_M and looks_like(other, each, ALIKE_RAD):
                count += 1
    return count / len(landmarks) / (math.pi * AROUND_M**2) if landmarks else 0.0


def turn_between(truth: Landmark, observed: Landmark) -> float:
    """Return the rotation from the observed to the true orientation, rad; NaN without one."""
    turns = number_or_nan(truth.orientation_rad), number_or_nan(observed.orientation_rad)
    return float(rotation_between(*turns, truth.type in HALF_TURN_TYPES))


def looks_like(one: Landmark, other: Landmark, turned_rad: float) -> bool:
    """Return whether two landmarks have the same kind and orientation."""
    return one.type == other.type and abs(turn_between(other, one)) < turned_rad


def add(found: list[Found], landmark: Landmark, pose: Pose) -> None:
    """Add a sighting to a known landmark, whose position is the mean of all sightings, or begin a new one."""
    for each in found:
        known = each.landmark
        if (
            math.dist((known.x_m, known.y_m), (landmark.x_m, landmark.y_m)) < SAME_M
            and looks_like(landmark, known, SAME_RAD)
            and not math.isnan(turn := turn_between(landmark, known))
        ):
            each.off.append((landmark.x_m - known.x_m, landmark.y_m - known.y_m, turn))
            each.places.append(pose[:2])
            share = 1 / len(each.places)
            each.landmark = replace(
                known,
                x_m=known.x_m + share * (landmark.x_m - known.x_m),
                y_m=known.y_m + share * (landmark.y_m - known.y_m),
                orientation_rad=math.remainder((known.orientation_rad or 0.0) + share * turn, math.tau),
            )
            return
    found.append(Found(landmark, [pose[:2]]))


def measured(samples: list[Sample]) -> MissionConfig:
    """Return the systematic and the random error of odometry in the surveyed part."""
    least = MissionConfig(timeout_s=1e6, tolerance_m=TOLERANCE_M, hash_tries=TRIES)
    pairs = [(seen_from(a.pose, b.pose), b.moved) for a, b in pairwise(samples)]
    ways = np.array([max(math.hypot(*told[:2]), SHORTEST_M) for _, told in pairs])
    turns = np.array([told[2] for _, told in pairs])
    off = np.array([np.subtract(true, told) for true, told in pairs])
    off[:, 2] = np.remainder(off[:, 2] + math.pi, math.tau) - math.pi
    causes = np.column_stack([ways, turns])
    (curve, turn), *_ = np.linalg.lstsq(causes, off[:, 2])
    chance = (off[:, 2] - causes @ (curve, turn)) ** 2
    way_rate, turn_rate = shares(ways, np.abs(turns), chance)
    way = np.sqrt(np.mean((off[:, 0] ** 2 + off[:, 1] ** 2) / ways))
    return replace(
        least,
        odometry_curve_deg=max(least.odometry_curve_deg, abs(math.degrees(curve))),
        odometry_turn=max(least.odometry_turn, abs(float(turn))),
        odometry_per_m_deg=max(least.odometry_per_m_deg, math.degrees(math.sqrt(way_rate))),
        odometry_turn_deg=max(least.odometry_turn_deg, math.degrees(math.sqrt(turn_rate))),
        odometry_way_m=max(least.odometry_way_m, float(way)),
    )


def shares(one: np.ndarray, other: np.ndarray, of: np.ndarray) -> tuple[float, float]:
    """Return the non-negative least-squares weights of two columns for the third."""
    rates, *_ = np.linalg.lstsq(np.column_stack([one, other]), of)
    if rates[0] < 0:
        return 0.0, float(of.mean() / other.mean())
    return (float(rates[0]), float(rates[1])) if rates[1] >= 0 else (float(of.mean() / one.mean()), 0.0)


def steps_of(samples: list[Sample]) -> Iterator[tuple[Sample, Pose, Pose, float]]:
    """Yield each sample with the odometry poses before and after it, from (0, 0, 0), and the path length so far."""
    now, travelled_m = (0.0, 0.0, 0.0), 0.0
    for i, sample in enumerate(samples):
        before = now
        if i:
            now, travelled_m = after(now, sample.moved), travelled_m + math.hypot(*sample.moved[:2])
        yield sample, before, now, travelled_m


def live(mission: EncodedMission, config: MissionConfig, samples: list[Sample]) -> Lived:
    """Replay the rest of a log as a robot that knows its start pose, its odometry errors and the encoded mission."""
    lived = Lived(scans=len(samples), landmarks=len(mission.nodes) - 1)
    start = samples[0].pose
    walker, state, belief = Walker(mission, config=config), State(), initial_belief(config, start)
    for i, (sample, before, now, travelled_m) in enumerate(steps_of(samples)):
        belief = belief.driven(before, now, odometry_errors_of(config))
        landmarks = extract(sample.scan, SCANNER).landmarks(*belief.pose)
        seen = Experience(float(i), *belief.pose, travelled_m, landmarks, spread=belief.pose_covariance)
        state, outcome = walker.step(state, seen)
        if outcome.fix is not None:
            lived.fixes += 1
            belief = fixed(config, belief, outcome.fix)
            if wrong := pose_error(sample.pose, belief.pose, belief.pose_covariance):
                lived.false[wrong] += 1
        elif outcome.reason is not None:
            lived.not_validated[outcome.reason.value] += 1
        alone_pose = after(start, now)
        lived.errors_m.append(math.dist(sample.pose[:2], belief.pose[:2]))
        lived.odometry_m.append(math.dist(sample.pose[:2], alone_pose[:2]))
        lived.path.append((sample.pose, belief.pose, alone_pose))
        lived.way_m = travelled_m
    lived.decoded = sum(node.landmark is not None for node in state.opened.values())
    return lived


def draw(lived: dict[str, Lived], out: Path) -> None:
    """Draw each log's paths: true, believed, and by odometry alone."""
    import matplotlib as mpl  # noqa: PLC0415 - only who wants a picture waits for it

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(1, len(lived), figsize=(6 * len(lived), 6), squeeze=False, layout="constrained")
    for ground, (name, each) in zip(axes[0], lived.items(), strict=True):
        for k, (words, colour) in enumerate((("corrected", "black"), ("believed", "C0"), ("odometry alone", "C3"))):
            path = np.array([row[k][:2] for row in each.path])
            ground.plot(*path.T, color=colour, lw=2.5 if k == 0 else 1.0, label=words, zorder=3 - k)
        around = np.array([row[0][:2] for row in each.path])
        (left, low), (right, high) = around.min(0) - 5, around.max(0) + 5
        ground.set(
            title=f"{name}: {each.decoded} of {each.landmarks} decoded, {sum(each.false.values())} false fixes",
            xlabel="x (m)", ylabel="y (m)", xlim=(left, right), ylim=(low, high), aspect="equal",
        )  # fmt: skip
    axes[0][0].legend()
    figure.savefig(out, dpi=110)


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("logs", nargs="+", type=Path)
    words.add_argument("--surveyed", type=float, default=0.5, help="share of a log that makes the mission [0.5]")
    words.add_argument("--picture", type=Path)
    words.add_argument("--json", action="store_true")
    wanted = words.parse_args()
    lived: dict[str, Lived] = {}
    for path in wanted.logs:
        samples = read(path)
        first = min(len(samples) - 1, max(1, int(len(samples) * wanted.surveyed)))
        try:
            mission, config = survey(path.stem, samples[:first], samples[first].pose)
        except UsageError as error:
            raise SystemExit(f"error: {path}: no mission can be made of it: {error}") from None
        encoded = build(mission, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)[0].mission  # noqa: S311
        lived[path.stem] = live(encoded, config, samples[first:])
        row = lived[path.stem].row(path.stem)
        print(json.dumps(row) if wanted.json else "  ".join(f"{name} {value}" for name, value in row.items()))
    if wanted.picture:
        draw(lived, wanted.picture)
    return 1 if any(each.false for each in lived.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
