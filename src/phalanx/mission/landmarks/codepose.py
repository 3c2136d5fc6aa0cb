"""Estimate the pose of a QR code from its four corner pixels: a homography, refined by least squares.

Only + - * / and square roots are used, so that an auditor computes the same landmark from the corners, bit by bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x1, F64x2
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.mission.angles import atan2, sin_cos, wrap
from phalanx.mission.observable import Landmark

ROUNDS = 12
# The normal of a code is accepted if the error of the second solution is larger by this factor and offset, or if both
# normals differ by less than 5 degrees.
SURE_TIMES, SURE_PX, SAME_COSINE = 2.0, 0.1, 0.9962
_EMPTY = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """A pinhole camera with radial distortion, in pixels. Raises: UsageError: a value is out of range."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    k1: float = 0.0  # radial distortion, in units of the focal length
    k2: float = 0.0  # likewise

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, self.k1, self.k2)
        if not (all(map(math.isfinite, numbers)) and min(self.fx, self.fy) > 0 and min(self.width, self.height) > 0):
            raise UsageError(f"a camera of {self.width} x {self.height} with focal lengths {self.fx}, {self.fy}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """Mounting pose of the camera on the robot; it looks horizontally."""

    x_m: float = 0.0  # robot frame (x forward, y left), z above the floor
    y_m: float = 0.0
    z_m: float = 0.3
    yaw_rad: float = 0.0  # direction of the optical axis, counter-clockwise from forward


@dataclass(frozen=True, slots=True)
class CodePose:
    """Pose of a QR code in the camera frame: x right, y down, z forward, metres."""

    at_m: tuple[float, float, float]  # centre of the code
    normal: tuple[float, float, float]  # unit vector into the wall
    error_px: float  # root mean square reprojection error of the corners
    other_error_px: float  # error of the ambiguous second solution, tilted the other way against the line of sight
    other_normal: tuple[float, float, float]  # normal of the second solution

    @property
    def sure(self) -> bool:
        """Return True if the normal is unambiguous: the second solution fits worse, or has nearly the same normal."""
        alike = sum(a * b for a, b in zip(self.normal, self.other_normal, strict=True)) > SAME_COSINE
        return alike or self.other_error_px > SURE_TIMES * self.error_px + SURE_PX


def code_pose(corners_px: NDArray[np.float64], size_m: float, camera: Intrinsics) -> CodePose | None:
    """Return the pose of a square from its corners; None if they are not the image of a square.

    Args:
        corners_px: (4, 2) pixels: top left, top right, bottom right, bottom left of the upright code.
    """
    corners = np.ascontiguousarray(corners_px, np.float64).reshape(4, 2)
    if not np.all(np.abs(corners) < 1e6):
        return None
    points = _normalised(corners, camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2)
    if not np.all(np.isfinite(points)):
        return None
    x, y, z, nx, ny, nz, ox, oy, oz, error, other = _pose(points, size_m).tolist()
    if error == math.inf:
        return None
    pixels = math.sqrt(camera.fx * camera.fy)
    return CodePose((x, y, z), (nx, ny, nz), error * pixels, other * pixels, (ox, oy, oz))


def qr_landmark(text: str, pose: CodePose, mount: Mount, x_m: float, y_m: float, heading_rad: float) -> Landmark:
    """Return a code as a landmark in the map frame, given the robot's pose.

    Its orientation points away from its wall; None if the normal is ambiguous.
    """
    across, _, ahead = pose.at_m
    normal_across, _, normal_ahead = pose.normal
    sine, cosine = sin_cos(mount.yaw_rad)
    # With yaw 0 the camera's x points to the robot's right, its z forward.
    x = mount.x_m + (cosine * ahead + sine * across)
    y = mount.y_m + (sine * ahead - cosine * across)
    into_x, into_y = cosine * normal_ahead + sine * normal_across, sine * normal_ahead - cosine * normal_across
    sine, cosine = sin_cos(heading_rad)
    # Of two solutions that fit almost equally, the wrong one would corrupt the robot's heading.
    facing = wrap(atan2(-into_y, -into_x) + heading_rad) if pose.sure else None
    return Landmark("qr", x_m + (cosine * x - sine * y), y_m + (sine * x + cosine * y), facing, text=text)


@kernel
def _normalised(corners: F64x2, fx: float, fy: float, cx: float, cy: float, k1: float, k2: float) -> F64x2:
    """Return pixels as x / z and y / z, undistorted."""
    points = np.empty((4, 2))
    for i in range(4):
        bent_x, bent_y = (corners[i, 0] - cx) / fx, (corners[i, 1] - cy) / fy
        x, y = bent_x, bent_y
        for _ in range(20):
            squared = x * x + y * y
            bend = 1.0 + squared * (k1 + squared * k2)
            if bend < 0.1:
                break
            x, y = bent_x / bend, bent_y / bend
        points[i, 0], points[i, 1] = x, y
    return points


@kernel
def _first_guess(points: F64x2, rotation: F64x2, at: F64x1, half: float) -> bool:
    """Set the pose of the square -half..half from its homography; return False if there is none."""
    x0, y0, x1, y1 = points[0, 0], points[0, 1], points[1, 0], points[1, 1]
    x2, y2, x3, y3 = points[2, 0], points[2, 1], points[3, 0], points[3, 1]
    # Homography from the unit square to the quadrilateral.
    dx1, dy1, dx2, dy2 = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    sx, sy = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    det = dx1 * dy2 - dx2 * dy1
    if abs(det) < _EMPTY:
        return False
    g, h = (sx * dy2 - dx2 * sy) / det, (dx1 * sy - sx * dy1) / det
    a, b = x1 - x0 + g * x1, x3 - x0 + h * x3
    d, e = y1 - y0 + g * y1, y3 - y0 + h * y3
    # Columns for coordinates from the centre, in metres: u = (x / half + 1) / 2.
    scale = 0.5 / half
    ux, uy, uz = a * scale, d * scale, g * scale
    vx, vy, vz = b * scale, e * scale, h * scale
    tx, ty, tz = x0 + 0.5 * (a + b), y0 + 0.5 * (d + e), 1.0 + 0.5 * (g + h)
    u, v = math.sqrt(ux * ux + uy * uy + uz * uz), math.sqrt(vx * vx + vy * vy + vz * vz)
    length = 0.5 * (u + v)
    if min(u, v) < _EMPTY or tz <= 0.0:
        return False
    ux, uy, uz, vx, vy, vz = ux / u, uy / u, uz / u, vx / v, vy / v, vz / v
    # Turn both columns by the same angle until they are orthogonal.
    sum_x, sum_y, sum_z, off_x, off_y, off_z = ux + vx, uy + vy, uz + vz, ux - vx, uy - vy, uz - vz
    plus = math.sqrt(sum_x * sum_x + sum_y * sum_y + sum_z * sum_z)
    minus = math.sqrt(off_x * off_x + off_y * off_y + off_z * off_z)
    if min(plus, minus) < 1e-6:
        return False
    plus, minus = 1.0 / (plus * math.sqrt(2.0)), 1.0 / (minus * math.sqrt(2.0))
    rotation[0, 0], rotation[0, 1] = sum_x * plus + off_x * minus, sum_x * plus - off_x * minus
    rotation[1, 0], rotation[1, 1] = sum_y * plus + off_y * minus, sum_y * plus - off_y * minus
    rotation[2, 0], rotation[2, 1] = sum_z * plus + off_z * minus, sum_z * plus - off_z * minus
    _third_column(rotation)
    at[0], at[1], at[2] = tx / length, ty / length, tz / length
    return True


@kernel
def _third_column(rotation: F64x2) -> None:
    """Set the third column of a rotation to the cross product of the first two."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rotation[i, 2] = rotation[j, 0] * rotation[k, 1] - rotation[k, 0] * rotation[j, 1]


@kernel
def _refine(points: F64x2, rotation: F64x2, at: F64x1, half: float) -> float:  # noqa: C901  # one system
    """Refine the pose by Gauss-Newton; return the root mean square error, or inf if it fails."""
    matrix = np.empty((6, 7))
    row = np.empty(7)
    error = np.inf
    for turn in range(ROUNDS + 1):
        matrix[:, :] = 0.0
        error = 0.0
        for i in range(4):
            side_x = half if i in (1, 2) else -half
            side_y = half if i in (2, 3) else -half
            rx = rotation[0, 0] * side_x + rotation[0, 1] * side_y
            ry = rotation[1, 0] * side_x + rotation[1, 1] * side_y
            rz = rotation[2, 0] * side_x + rotation[2, 1] * side_y
            x, y, z = rx + at[0], ry + at[1], rz + at[2]
            if z < 1e-6:
                return np.inf
            u, v = x / z, y / z
            for axis in range(2):
                # d(u) = (dx - u dz) / z; a turn w moves the point by w x r.
                if axis == 0:
                    row[0], row[1], row[2] = -u * ry / z, (rz + u * rx) / z, -ry / z
                    row[3], row[4], row[5] = 1.0 / z, 0.0, -u / z
                    row[6] = points[i, 0] - u
                else:
                    row[0], row[1], row[2] = -(rz + v * ry) / z, v * rx / z, rx / z
                    row[3], row[4], row[5] = 0.0, 1.0 / z, -v / z
                    row[6] = points[i, 1] - v
                error += row[6] * row[6]
                for p in range(6):
                    for q in range(7):
                        matrix[p, q] += row[p] * row[q]
        if turn == ROUNDS:
            break
        for p in range(6):
            matrix[p, p] *= 1.0 + 1e-9
        if not _solve(matrix):
            return np.inf
        _turn(rotation, matrix[0, 6], matrix[1, 6], matrix[2, 6])
        for k in range(3):
            at[k] += matrix[3 + k, 6]
    return math.sqrt(error / 4.0)


@kernel
def _solve(matrix: F64x2) -> bool:
    """Solve a (6, 7) system by Gauss-Jordan with pivoting, into the last column; return False if it is singular."""
    for p in range(6):
        best = p
        for q in range(p + 1, 6):
            if abs(matrix[q, p]) > abs(matrix[best, p]):
                best = q
        if abs(matrix[best, p]) < _EMPTY:
            return False
        for k in range(7):
            matrix[p, k], matrix[best, k] = matrix[best, k], matrix[p, k]
        for q in range(6):
            if q != p:
                factor = matrix[q, p] / matrix[p, p]
                for k in range(p, 7):
                    matrix[q, k] -= factor * matrix[p, k]
    for p in range(6):
        matrix[p, 6] /= matrix[p, p]
    return True


@kernel
def _turn(rotation: F64x2, wx: float, wy: float, wz: float) -> None:
    """Rotate by the small vector w, in place, and keep the columns orthonormal (Gram-Schmidt)."""
    for column in range(2):
        x, y, z = rotation[0, column], rotation[1, column], rotation[2, column]
        rotation[0, column] = x + (wy * z - wz * y)
        rotation[1, column] = y + (wz * x - wx * z)
        rotation[2, column] = z + (wx * y - wy * x)
        if column == 1:
            dot = 0.0
            for k in range(3):
                dot += rotation[k, 0] * rotation[k, 1]
            for k in range(3):
                rotation[k, 1] -= dot * rotation[k, 0]
        length = 0.0
        for k in range(3):
            length += rotation[k, column] * rotation[k, column]
        length = math.sqrt(length)
        for k in range(3):
            rotation[k, column] = rotation[k, column] / length
    _third_column(rotation)


@kernel
def _pose(points: F64x2, size_m: float) -> F64x1:
    """Return position, normal into the wall, normal of the second solution, and both errors in focal lengths.

    The errors are inf if there is no solution.
    """
    half = 0.5 * size_m
    best = np.full(11, np.inf)
    rotation, at = np.empty((3, 3)), np.empty(3)
    if not _first_guess(points, rotation, at, half):
        return best
    # The second solution is the square tilted the other way against the line of sight: half a turn about that line, and
    # half a turn of the square about its normal.
    other = np.empty((3, 3))
    sight = math.sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2])
    for column in range(2):
        dot = 0.0
        for k in range(3):
            dot += at[k] / sight * rotation[k, column]
        for k in range(3):
            other[k, column] = rotation[k, column] - 2.0 * dot * at[k] / sight
    _third_column(other)
    other_at = at.copy()
    error = _refine(points, rotation, at, half)
    other_error = _refine(points, other, other_at, half)
    if other_error < error:
        rotation, other = other, rotation
        at, other_at = other_at, at
        error, other_error = other_error, error
    for k in range(3):
        best[k], best[3 + k], best[6 + k] = at[k], rotation[k, 2], other[k, 2]
    if error < np.inf:
        best[9], best[10] = error, other_error
    return best
