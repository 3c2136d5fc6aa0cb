"""Read QR codes in an image: their texts, with zxing, and their corners to a fraction of a pixel.

Auditors do not replay images; the logged reading has the texts and the corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import zxingcpp
from numpy.typing import NDArray

from phalanx.errors import UsageError

# Search range for the border around zxing's corner, in pixels plus a share of the code's edge.
REACH_PX = 3.0
REACH_PART = 0.04
SAMPLES = 48
# Corners are rounded to this fraction of a pixel.
PART_PX = 1 / 64
_RISE = 12.0  # smallest step of grey values at a border
_STEP_PX = 0.5
_QR = zxingcpp.BarcodeFormats(zxingcpp.BarcodeFormat.QRCode)


@dataclass(frozen=True, slots=True, eq=False)
class SeenCode:
    """A QR code in an image."""

    text: str
    # (4, 2) top left, top right, bottom right, bottom left of the upright code; multiples of PART_PX
    corners_px: NDArray[np.float64]


def read_codes(picture: NDArray[np.uint8]) -> tuple[SeenCode, ...]:
    """Return the QR codes in a greyscale image, (height, width), from left to right.

    Raises: UsageError: not a greyscale image.
    """
    if picture.ndim != 2 or picture.dtype != np.uint8 or 0 in picture.shape:
        raise UsageError(f"an image of shape {picture.shape}, {picture.dtype}", "use (height, width), uint8")
    codes = []
    for code in zxingcpp.read_barcodes(picture, formats=_QR):
        if not code.valid:
            continue
        place = code.position
        corners = np.array(
            [(p.x, p.y) for p in (place.top_left, place.top_right, place.bottom_right, place.bottom_left)], np.float64
        )
        sharp = np.rint(_sharpened(picture, corners) / PART_PX) * PART_PX
        codes.append(SeenCode(code.text, sharp))
    return tuple(sorted(codes, key=lambda code: (code.corners_px[:, 0].mean(), code.text)))


def _sharpened(picture: NDArray[np.uint8], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the crossings of lines fitted to the code's dark border, or the given corners if no border is found."""
    middle = corners.mean(0)
    lines = []
    for i in range(4):
        line = _border(picture, corners[i], corners[(i + 1) % 4], middle)
        if line is None:
            return corners
        lines.append(line)
    out = np.empty((4, 2))
    for i in range(4):
        (p, along), (q, other) = lines[i - 1], lines[i]
        cross = along[0] * other[1] - along[1] * other[0]
        if abs(cross) < 0.1:
            return corners
        out[i] = p + along * (((q[0] - p[0]) * other[1] - (q[1] - p[1]) * other[0]) / cross)
    edge = np.hypot(*(corners[1] - corners[0]))
    return out if np.max(np.hypot(*(out - corners).T)) < REACH_PX + 2 * REACH_PART * edge else corners


def _border(
    picture: NDArray[np.uint8], a: NDArray[np.float64], b: NDArray[np.float64], middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return (point, unit direction) of the code's border line between corners a and b, or None."""
    length = float(np.hypot(*(b - a)))
    if length < 8:
        return None
    along = (b - a) / length
    out = np.array([along[1], -along[0]])
    if out @ (middle - a) > 0:
        out = -out
    reach = REACH_PX + REACH_PART * length
    at = np.linspace(0.03, 0.97, SAMPLES) * length
    off = np.arange(-reach, reach + _STEP_PX, _STEP_PX)
    where = a + at[:, None, None] * along + off[None, :, None] * out
    rise = np.diff(_grey(picture, where), axis=1)
    # Take the outermost steep rise from dark to light: only the quiet zone is outside.
    steep = rise > np.maximum(_RISE * _STEP_PX, 0.5 * rise.max(axis=1, initial=0.0)[:, None])
    rows = np.flatnonzero(steep.any(axis=1))
    if len(rows) < SAMPLES // 4:
        return None
    last = steep.shape[1] - 1 - np.argmax(steep[rows, ::-1], axis=1)
    peak = np.array([_peak(rise[row], column) for row, column in zip(rows, last, strict=True)])
    border = off[0] + (peak + 0.5) * _STEP_PX
    x = at[rows]
    keep = np.abs(border - np.median(border)) < max(1.5, 0.5 * REACH_PART * length)
    for _ in range(4):
        if keep.sum() < SAMPLES // 6:
            return None
        slope, level = np.polyfit(x[keep], border[keep], 1)
        rest = np.abs(border - (slope * x + level))
        keep = rest < max(0.3, 2.0 * float(np.median(rest[keep])))
    direction = along + slope * out
    return a + level * out, direction / np.hypot(*direction)


def _peak(rise: NDArray[np.float64], column: int) -> float:
    """Return the centre of the rise around `column`, weighted by its slope."""
    low, high = max(0, column - 3), min(len(rise), column + 3)
    weight = np.maximum(rise[low:high], 0.0)
    return float(low + (weight @ np.arange(high - low)) / weight.sum())


def _grey(picture: NDArray[np.uint8], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return bilinear samples at (..., 2) pixels; the centre of the first pixel is (0, 0)."""
    height, width = picture.shape
    x = np.clip(at[..., 0], 0, width - 1.001)
    y = np.clip(at[..., 1], 0, height - 1.001)
    column, row = x.astype(np.int64), y.astype(np.int64)
    fx, fy = x - column, y - row
    top = (1 - fx) * picture[row, column] + fx * picture[row, column + 1]
    low = (1 - fx) * picture[row + 1, column] + fx * picture[row + 1, column + 1]
    out: NDArray[np.float64] = (1 - fy) * top + fy * low
    return out
