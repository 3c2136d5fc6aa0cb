"""Find walls in a scan: split it at jumps and bends, merge straight pieces, fit a line to each.

Points and walls are ordered by bearing, counter-clockwise; the robot is on the left of every wall's direction. All
functions are kernels, so that an auditor's replay gives the same bits.
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import BOOLx1, F64x1, F64x2, I64x1, I64x2
from phalanx.kernel import kernel

# Largest step in beams, over beams without a reading, between two points of one wall.
GAP_BEAMS = 4
# Pieces shorter than this may be legs or columns that look straight.
ROUND_M = 0.6
# A piece is round if its middle stands out by this share of `line_m`.
ROUND = 0.3
# A step of more than `line_m` between two faces of at least FACE_M distorts walls shorter than STEPPED_M.
STEPPED_M, FACE_M = 1.5, 0.07
# Columns of an array of walls: a point on the wall, its unit direction, its first and its last point.
X, Y, ALONG_X, ALONG_Y, FROM_X, FROM_Y, TO_X, TO_Y = range(8)


@kernel
def points_of(ranges: F64x1, cosines: F64x1, sines: F64x1, range_m: float) -> tuple[F64x1, F64x1, I64x1]:
    """Return (x, y, beam) of the hits within `range_m`; robot frame, metres."""
    x, y, beam = np.empty(len(ranges)), np.empty(len(ranges)), np.empty(len(ranges), np.int64)
    count = 0
    for k in range(len(ranges)):
        if ranges[k] <= range_m:
            x[count], y[count], beam[count] = ranges[k] * cosines[k], ranges[k] * sines[k], k
            count += 1
    return x[:count], y[:count], beam[:count]


@kernel
def breaks_of(ranges: F64x1, beam: I64x1, step_rad: float, jump_m: float, graze_slope: float) -> BOOLx1:
    """Return, for each point, True if it begins a new run: it is on another surface than the point before.

    `graze_slope` is the cotangent of the smallest angle at which a wall still counts as one surface: the largest growth
    of its range, in units of the distance between two beams.
    """
    count = len(beam)
    new_run = np.empty(count, np.bool_)
    for i in range(count):
        if i == 0 or beam[i] - beam[i - 1] > GAP_BEAMS:
            new_run[i] = True
            continue
        near, far = ranges[beam[i - 1]], ranges[beam[i]]
        if near > far:
            near, far = far, near
        gap = beam[i] - beam[i - 1]
        new_run[i] = far - near > jump_m + graze_slope * near * step_rad * gap
        for k in range(beam[i - 1] + 1, beam[i]):
            # A beam between the points that misses or hits farther away separates the surfaces.
            if not np.isnan(ranges[k]):
                new_run[i] = True
    return new_run


@kernel
def _farthest_from_chord(x: F64x1, y: F64x1, first: int, last: int) -> tuple[int, float]:
    chord_x, chord_y = x[last] - x[first], y[last] - y[first]
    length = math.sqrt(chord_x * chord_x + chord_y * chord_y)
    worst, at = -1.0, first
    for i in range(first + 1, last):
        dx, dy = x[i] - x[first], y[i] - y[first]
        distance = abs(chord_x * dy - chord_y * dx) / length if length > 1e-9 else math.sqrt(dx * dx + dy * dy)
        if distance > worst:
            worst, at = distance, i
    return at, worst


@kernel
def split_run(x: F64x1, y: F64x1, first: int, last: int, split_m: float, starts: I64x1) -> int:
    """Write the first points of the straight pieces of first..last to `starts`; return the number of pieces.

    Each piece ends at the first point of the next.
    """
    stack = np.empty((last - first + 2, 2), np.int64)
    stack[0, 0], stack[0, 1] = first, last
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        at, distance = _farthest_from_chord(x, y, a, b)
        if distance > split_m:
            # Push the left half last, so that pieces come in order.
            stack[depth, 0], stack[depth, 1] = at, b
            stack[depth + 1, 0], stack[depth + 1, 1] = a, at
            depth += 2
        else:
            starts[count] = a
            count += 1
    return count


@kernel
def fit_line(x: F64x1, y: F64x1, first: int, last: int) -> tuple[float, float, float, float]:
    """Return the least squares line (x, y, along_x, along_y), directed from `first` towards `last`."""
    n = last - first + 1
    sum_x, sum_y, sum_xx, sum_xy, sum_yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first, last + 1):
        dx, dy = x[i] - x[first], y[i] - y[first]
        sum_x += dx
        sum_y += dy
        sum_xx += dx * dx
        sum_xy += dx * dy
        sum_yy += dy * dy
    mean_x, mean_y = sum_x / n, sum_y / n
    xx, xy, yy = sum_xx - sum_x * mean_x, sum_xy - sum_x * mean_y, sum_yy - sum_y * mean_y
    # The eigenvector of the larger eigenvalue, from the row of the matrix that gives the longer vector.
    root = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)
    if xx >= yy:
        along_x, along_y = 0.5 * (xx - yy + root), xy
    else:
        along_x, along_y = xy, 0.5 * (yy - xx + root)
    length = math.sqrt(along_x * along_x + along_y * along_y)
    if length < 1e-12:
        along_x, along_y, length = 1.0, 0.0, 1.0
    if along_x * (x[last] - x[first]) + along_y * (y[last] - y[first]) < 0.0:
        length = -length
    return x[first] + mean_x, y[first] + mean_y, along_x / length, along_y / length


@kernel
def _strays(x: F64x1, y: F64x1, first: int, last: int, split_m: float) -> bool:
    """Return True if a point of first..last is farther than `split_m` from the line fitted to all of them."""
    cx, cy, ax, ay = fit_line(x, y, first, last)
    for i in range(first, last + 1):  # noqa: SIM110 - kernels know no generators
        if abs(ax * (y[i] - cy) - ay * (x[i] - cx)) > split_m:
            return True
    return False


@kernel
def _bulge(x: F64x1, y: F64x1, first: int, last: int, line: tuple[float, float, float, float]) -> float:
    """Return how far the middle third stands out to the left of both outer thirds: about 0 for flat walls."""
    cx, cy, ax, ay = line
    third = (last - first + 1) // 3
    middle, ends = 0.0, 0.0
    for i in range(first, last + 1):
        off = ax * (y[i] - cy) - ay * (x[i] - cx)
        if first + third <= i <= last - third:
            middle += off
        else:
            ends += off
    return middle / (last - first + 1 - 2 * third) - ends / (2 * third)


@kernel
def _step(x: F64x1, y: F64x1, first: int, last: int, line: tuple[float, float, float, float]) -> float:
    """Return the largest step between two parts of a wall that are fitted by parallel lines.

    Each part is at least FACE_M long: points of the next wall around a corner cover less.
    """
    cx, cy, ax, ay = line
    n = last - first + 1
    along, off = np.empty(n), np.empty(n)
    s, r, ss, sr = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        dx, dy = x[first + i] - cx, y[first + i] - cy
        along[i], off[i] = ax * dx + ay * dy, ax * dy - ay * dx
        s, r, ss, sr = s + along[i], r + off[i], ss + along[i] * along[i], sr + along[i] * off[i]
    most, s1, r1, ss1, sr1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n - 1):
        s1, r1 = s1 + along[i], r1 + off[i]
        ss1, sr1 = ss1 + along[i] * along[i], sr1 + along[i] * off[i]
        if abs(along[i] - along[0]) < FACE_M or abs(along[n - 1] - along[i + 1]) < FACE_M:
            continue
        n1, n2, s2, r2 = i + 1, n - i - 1, s - s1, r - r1
        spread = ss - s1 * s1 / n1 - s2 * s2 / n2
        slope = (sr - s1 * r1 / n1 - s2 * r2 / n2) / spread if spread > 1e-9 else 0.0
        most = max(most, abs(r2 / n2 - r1 / n1 - slope * (s2 / n2 - s1 / n1)))
    return most


@kernel
def _off(x: F64x1, y: F64x1, i: int, line: tuple[float, float, float, float]) -> float:
    """Return the distance of a point from a line."""
    off: float = line[2] * (y[i] - line[1]) - line[3] * (x[i] - line[0])
    return abs(off)


@kernel
def _is_flat(
    x: F64x1, y: F64x1, first: int, last: int, line: tuple[float, float, float, float], long_m: float, line_m: float
) -> bool:
    """Return True if a wall of length `long_m` is one flat face, not a round object or two faces with a step."""
    if long_m < ROUND_M and abs(_bulge(x, y, first, last, line)) > ROUND * line_m:
        return False
    return long_m >= STEPPED_M or _step(x, y, first, last, line) <= line_m


@kernel
def bulge(x: F64x1, y: F64x1, walls: F64x2, spans: I64x2, w: int) -> float:
    """Return how far the middle of wall w stands out towards the robot."""
    first, last = spans[w, 0] + 1, spans[w, 1] - 1
    line = walls[w, X], walls[w, Y], walls[w, ALONG_X], walls[w, ALONG_Y]
    return _bulge(x, y, first, last, line) if last - first >= 2 else 0.0


@kernel
def _border(x: F64x1, y: F64x1, walls: F64x2, spans: I64x2, w: int) -> int:
    """Return the last point of wall w, such that the points of w and w + 1 fit their two lines best."""
    best, sum_ = 0.0, 0.0
    at: int = spans[w, 0] - 1
    for i in range(spans[w, 0], spans[w + 1, 1] + 1):
        off = walls[w, ALONG_X] * (y[i] - walls[w, Y]) - walls[w, ALONG_Y] * (x[i] - walls[w, X])
        beyond = walls[w + 1, ALONG_X] * (y[i] - walls[w + 1, Y]) - walls[w + 1, ALONG_Y] * (x[i] - walls[w + 1, X])
        sum_ += off * off - beyond * beyond
        if sum_ < best:
            best, at = sum_, i
    return at


@kernel
def _trimmed(first: int, last: int) -> tuple[int, int]:
    """Return first and last point without the outermost points, which may belong to the next wall."""
    points = last - first + 1
    trim = 2 if points >= 12 else (1 if points >= 8 else 0)
    return first + trim, last - trim


@kernel
def _part(x: F64x1, y: F64x1, new_run: BOOLx1, walls: F64x2, spans: I64x2) -> F64x2:
    """Return the walls, refitted to their own points only: points of the next wall within `split_m` distort the fit."""
    parted = walls.copy()
    for w in range(len(walls)):
        first, last = _trimmed(spans[w, 0], spans[w, 1])
        begin, end = first, last
        if w > 0 and not np.any(new_run[spans[w - 1, 1] + 1 : spans[w, 0] + 1]):
            begin = max(first, _border(x, y, walls, spans, w - 1) + 1)
        if w + 1 < len(walls) and not np.any(new_run[spans[w, 1] + 1 : spans[w + 1, 0] + 1]):
            end = min(last, _border(x, y, walls, spans, w))
        if begin < end and (begin > first or end < last):
            parted[w, X], parted[w, Y], parted[w, ALONG_X], parted[w, ALONG_Y] = fit_line(x, y, begin, end)
    return parted


@kernel
def walls_of(
    x: F64x1, y: F64x1, new_run: BOOLx1, split_m: float, line_m: float, wall_min_m: float, min_points: int
) -> tuple[F64x2, I64x2]:
    """Return the (w, 8) walls, and the (w, 2) first and last point of each.

    Lines are found by split and merge (Pavlidis and Horowitz, 1974). Source: Encoded graphs Alg. 1, getF.
    """
    count = len(x)
    starts = np.empty(count + 1, np.int64)
    walls = np.empty((count // min_points + 1, 8))
    spans = np.empty((count // min_points + 1, 2), np.int64)
    found = 0
    run = 0
    while run < count:
        run_end = run + 1
        while run_end < count and not new_run[run_end]:
            run_end += 1
        if run_end - run < min_points:
            run = run_end
            continue
        pieces = split_run(x, y, run, run_end - 1, split_m, starts)
        starts[pieces] = run_end - 1
        a = 0
        while a < pieces:
            b = a + 1
            # Noise may split a straight wall: merge pieces that one line fits.
            while b < pieces and not _strays(x, y, starts[a], starts[b + 1], split_m):
                b += 1
            first, last = starts[a], starts[b]
            a = b
            if last - first + 1 < min_points:
                continue
            begin, end = _trimmed(first, last)
            line = fit_line(x, y, begin, end)
            # The end point of a piece may belong to the next one, a step away: drop it if it is off the line.
            first, last = first + (_off(x, y, first, line) > line_m), last - (_off(x, y, last, line) > line_m)
            dx, dy = x[last] - x[first], y[last] - y[first]
            long_m = math.sqrt(dx * dx + dy * dy)
            if long_m < wall_min_m or not _is_flat(x, y, begin, end, line, long_m, line_m):
                continue
            walls[found, X], walls[found, Y], walls[found, ALONG_X], walls[found, ALONG_Y] = line
            spans[found, 0], spans[found, 1] = first, last
            found += 1
        run = run_end
    walls, spans = _part(x, y, new_run, walls[:found], spans[:found]), spans[:found]
    for w in range(found):
        cx, cy, ax, ay = walls[w, X], walls[w, Y], walls[w, ALONG_X], walls[w, ALONG_Y]
        for end in range(2):
            i = spans[w, end]
            s = ax * (x[i] - cx) + ay * (y[i] - cy)
            walls[w, FROM_X + 2 * end] = cx + s * ax
            walls[w, FROM_Y + 2 * end] = cy + s * ay
    return walls, spans
