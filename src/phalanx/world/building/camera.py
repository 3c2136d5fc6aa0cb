"""Simulated camera of a robot in a building with QR codes on the walls: renders and decodes grey pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import segno
from numpy.typing import NDArray

from phalanx.config.parameter import check_limits, within
from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan, WallCode
from phalanx.mission.landmarks.codepose import Intrinsics, Mount
from phalanx.mission.landmarks.codes import SeenCode, read_codes

from .odometry import Pose

_NOBODY = np.zeros((0, 3))
# Width of the white margin around a code in modules, as the standard requires.
QUIET = 4
# Rays per pixel on each axis, for small and for large codes: they blur the edges of modules as a lens does.
FINE, COARSE, LARGE_PX = 3, 2, 100
WALL_GREY, DARK, LIGHT = 150.0, 25.0, 235.0
NEAR_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """Lens, mount and image quality of a camera. Source: Encoded graphs §V-B."""

    # Default: 60 degrees on 1280 x 720 pixels, as the paper's Logitech C270
    intrinsics: Intrinsics = field(
        default_factory=lambda: Intrinsics(fx=1108.0, fy=1108.0, cx=639.5, cy=359.5, width=1280, height=720)
    )
    mount: Mount = field(default_factory=Mount)
    noise_grey: float = within(3.0, 0, 100)  # standard deviation per pixel, on a scale of 255
    exposure_s: float = within(0.005, 0, 1)  # duration of motion blur when the robot turns
    # Brightness at the left and the right border of the picture; 1 is daylight
    light: tuple[float, float] = (1.0, 0.8)
    range_m: float = within(6.0, NEAR_M, 100)  # farther codes are not rendered, as they cannot be decoded

    def __post_init__(self) -> None:
        check_limits(self)
        if not all(0 <= side <= 4 for side in self.light):
            raise UsageError(f"light of {self.light}", "use 0 to 4 on both sides; 1 is daylight")
        if self.intrinsics.k1 or self.intrinsics.k2:
            raise UsageError("the simulated lens has no distortion", "set k1 and k2 to 0")


class Camera:
    """A camera that sees the codes of a floor plan."""

    def __init__(self, plan: FloorPlan, config: CameraConfig | None = None) -> None:
        self.config = config or CameraConfig()
        self._plan = plan
        self._grain: NDArray[np.float32] | None = None
        lens = self.config.intrinsics
        self._light = np.linspace(*self.config.light, lens.width, dtype=np.float32)

    @property
    def eye(self) -> tuple[Intrinsics, Mount]:
        """Return the camera model with which robots and auditors locate a code."""
        return self.config.intrinsics, self.config.mount

    def picture(
        self, pose: Pose, random: np.random.Generator, people: NDArray[np.float64] = _NOBODY, turn_radps: float = 0.0
    ) -> NDArray[np.uint8]:
        """Return a (height, width) grey picture from the robot's pose; people, (m, 3) discs, occlude codes."""
        return self._picture(self._shown(pose, people), self._shift(random), turn_radps)

    def look(
        self, pose: Pose, random: np.random.Generator, people: NDArray[np.float64] = _NOBODY, turn_radps: float = 0.0
    ) -> tuple[SeenCode, ...]:
        """Return the codes read in a `picture` from a pose; a picture without codes is not rendered."""
        shown, shift = self._shown(pose, people), self._shift(random)
        return read_codes(self._picture(shown, shift, turn_radps)) if shown else ()

    def _shown(self, pose: Pose, people: NDArray[np.float64]) -> list[_Shown]:
        """Return the codes visible from a pose, farthest first."""
        codes = sorted(self._plan.codes, key=lambda code: -math.hypot(code.x_m - pose[0], code.y_m - pose[1]))
        found = (
            _shown_in(code.text, self._corners(pose, code), self.config.intrinsics)
            for code in codes
            if self._in_sight(pose, code, people)
        )
        return [shown for shown in found if shown is not None]

    def _picture(self, shown: list[_Shown], shift: int, turn_radps: float) -> NDArray[np.uint8]:
        lens = self.config.intrinsics
        picture = np.full((lens.height, lens.width), WALL_GREY, np.float32)
        for code in shown:
            _draw(picture, code, lens)
        smear = round(abs(turn_radps) * self.config.exposure_s * lens.fx)
        if smear > 1:
            sums = np.cumsum(np.pad(picture, ((0, 0), (smear, 0)), mode="edge"), axis=1, dtype=np.float64)
            picture = ((sums[:, smear:] - sums[:, :-smear]) / smear).astype(np.float32)
        picture *= self._light
        if self._grain is not None:
            picture += np.roll(self._grain, shift).reshape(lens.height, lens.width)
        np.rint(picture, out=picture)
        np.clip(picture, 0, 255, out=picture)
        return picture.astype(np.uint8)

    def _shift(self, random: np.random.Generator) -> int:
        # A million normal numbers take longer than everything else: draw them once, and shift them for every picture.
        pixels = self.config.intrinsics.height * self.config.intrinsics.width
        if not self.config.noise_grey:
            return 0
        if self._grain is None:
            self._grain = np.float32(self.config.noise_grey) * random.standard_normal(pixels, np.float32)
        return int(random.integers(pixels))

    def _eye(self, pose: Pose) -> Pose:
        x, y, heading = pose
        mount = self.config.mount
        cosine, sine = math.cos(heading), math.sin(heading)
        return (
            x + cosine * mount.x_m - sine * mount.y_m,
            y + sine * mount.x_m + cosine * mount.y_m,
            heading + mount.yaw_rad,
        )

    def _in_sight(self, pose: Pose, code: WallCode, people: NDArray[np.float64]) -> bool:
        x, y, _ = self._eye(pose)
        to_x, to_y = code.x_m - x, code.y_m - y
        away = math.hypot(to_x, to_y)
        # A code is invisible from behind.
        if (
            not NEAR_M < away < self.config.range_m
            or to_x * math.cos(code.facing_rad) + to_y * math.sin(code.facing_rad) > 0
        ):
            return False
        for person_x, person_y, radius in people.tolist():
            along = max(0.0, min(1.0, ((person_x - x) * to_x + (person_y - y) * to_y) / (away * away)))
            if math.hypot(person_x - x - along * to_x, person_y - y - along * to_y) < radius:
                return False
        side_x, side_y = -math.sin(code.facing_rad) * code.size_m / 2, math.cos(code.facing_rad) * code.size_m / 2
        return all(self._plan.sees((x, y), (code.x_m + s * side_x, code.y_m + s * side_y)) for s in (-1, 0, 1))

    def _corners(self, pose: Pose, code: WallCode) -> NDArray[np.float64]:
        """Return (4, 3) corners of the code in the camera's frame: x right, y down, z forward, metres."""
        x, y, heading = self._eye(pose)
        # Unit vector to the right, as seen from the front of the wall, times half the size.
        right = np.array([-math.sin(code.facing_rad), math.cos(code.facing_rad)]) * code.size_m / 2
        floor = np.array([code.x_m, code.y_m]) + np.array([-1, 1, 1, -1])[:, None] * right - (x, y)
        up = code.z_m - self.config.mount.z_m + np.array([1, 1, -1, -1]) * code.size_m / 2
        cosine, sine = math.cos(heading), math.sin(heading)
        return np.column_stack([floor @ (sine, -cosine), -up, floor @ (cosine, sine)])


@lru_cache(maxsize=1024)
def _modules(text: str) -> NDArray[np.float64]:
    """Return the (n, n) grey values of a code's modules, with its margin."""
    try:
        matrix = segno.make_qr(text, error="m").matrix
    except segno.DataOverflowError as error:
        raise UsageError(f"a text of {len(text)} characters does not fit into a QR code") from error
    dark = np.pad(np.array([list(row) for row in matrix], dtype=np.float64), QUIET)
    return LIGHT + (DARK - LIGHT) * dark


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """A code in a picture: grey values of its modules, the map from rays to modules, and its bounding pixels."""

    modules: NDArray[np.float64]
    to_modules: NDArray[np.float64]
    left: int
    right: int
    top: int
    bottom: int


def _shown_in(text: str, corners: NDArray[np.float64], lens: Intrinsics) -> _Shown | None:
    """Project a code into the picture; return None if it covers no pixel."""
    modules = _modules(text)
    count = len(modules) - 2 * QUIET
    origin = corners[0]
    across, down = (corners[1] - corners[0]) / count, (corners[3] - corners[0]) / count
    rim = np.array([(-QUIET, -QUIET), (count + QUIET, -QUIET), (count + QUIET, count + QUIET), (-QUIET, count + QUIET)])
    outer = origin + rim @ np.stack([across, down])
    if outer[:, 2].min() < NEAR_M:
        return None
    x, y = lens.cx + lens.fx * outer[:, 0] / outer[:, 2], lens.cy + lens.fy * outer[:, 1] / outer[:, 2]
    left, right = max(0, math.floor(x.min())), min(lens.width - 1, math.ceil(x.max()))
    top, bottom = max(0, math.floor(y.min())), min(lens.height - 1, math.ceil(y.max()))
    if left > right or top > bottom:
        return None
    # Rays (u, v, 1) → modules, by the inverse of the plane's homography.
    to_modules = np.linalg.pinv(np.column_stack([across, down, origin]))
    return _Shown(modules, to_modules, left, right, top, bottom)


def _draw(picture: NDArray[np.float32], code: _Shown, lens: Intrinsics) -> None:
    """Draw a code into a picture by mapping rays through its pixels to modules."""
    modules = code.modules
    rate = COARSE if max(code.right - code.left, code.bottom - code.top) > LARGE_PX else FINE
    fine = (np.arange(rate) + 0.5) / rate - 0.5
    u = ((np.arange(code.left, code.right + 1)[:, None] + fine).ravel() - lens.cx) / lens.fx
    v = ((np.arange(code.top, code.bottom + 1)[:, None] + fine).ravel() - lens.cy) / lens.fy
    a, b, c = (row[0] * u + row[1] * v[:, None] + row[2] for row in code.to_modules)
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = np.floor(a / c) + QUIET, np.floor(b / c) + QUIET
    on_code = (c > 0) & (column >= 0) & (column < len(modules)) & (row >= 0) & (row < len(modules))
    column, row = np.where(on_code, column, 0).astype(np.int64), np.where(on_code, row, 0).astype(np.int64)
    patch = picture[code.top : code.bottom + 1, code.left : code.right + 1]
    under = np.repeat(np.repeat(patch, rate, axis=0), rate, axis=1)
    rays = np.where(on_code, modules[row, column], under)
    patch[:] = rays.reshape(len(patch), rate, -1, rate).mean(axis=(1, 3))
