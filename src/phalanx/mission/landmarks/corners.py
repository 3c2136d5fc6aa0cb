"""Find corners in a scan: places where two walls meet, or where a wall ends in front of something farther away.

Corners of a room are "convex"; reflex corners are "concave" (the paper's word): jambs, pillars, ends of walls. At a
jump of the range only the near side is an edge; the far side is just the limit of the view.
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import F64x2, I64x2
from phalanx.kernel import kernel

from .scan import Limits, View
from .walls import ALONG_X, ALONG_Y, ROUND, X, Y, bulge

Edge = tuple[float, float, float]  # x, y and beam
# Most beams without a reading at an edge; with more the edge is rejected.
SILENT_BEAMS = 1
# Most points on the wrong side of a bend due to noise.
SLACK_POINTS = 8
# Share of `line_m` over which a wall may leave its line gradually, beside the depth and the spacing of its points.
SHARP = 0.5
# Points of other surfaces may distort a wall that is shorter than this.
SHORT_M = 1.0
# Columns of an array of corners: position, beam (.5 if between two beams), wall before and after (-1 if not seen).
CORNER_X, CORNER_Y, BEAM, BEFORE, AFTER, CONVEX = range(6)


@kernel
def line_crossing(walls: F64x2, a: int, b: int) -> tuple[float, float, float]:
    """Return (x, y, sine of the angle from a to b) of the crossing of two walls' lines; sine 0 means no crossing."""
    ax, ay, bx, by = walls[a, ALONG_X], walls[a, ALONG_Y], walls[b, ALONG_X], walls[b, ALONG_Y]
    sine = ax * by - ay * bx
    if sine == 0.0:
        return walls[a, X], walls[a, Y], 0.0
    s = ((walls[b, X] - walls[a, X]) * by - (walls[b, Y] - walls[a, Y]) * bx) / sine
    return walls[a, X] + s * ax, walls[a, Y] + s * ay, sine


@kernel
def _grazes(x: float, y: float, walls: F64x2, w: int, graze_sine: float) -> bool:
    """Return True if the robot sees point x, y of wall `w` at too flat an angle."""
    grazes: bool = abs(x * walls[w, ALONG_Y] - y * walls[w, ALONG_X]) < graze_sine * math.sqrt(x * x + y * y)
    return grazes


@kernel
def _runs_away(v: View, walls: F64x2, spans: I64x2, w: int, graze_sine: float) -> bool:
    """Return True if the robot sees the farther half of a short wall at too flat an angle.

    Such a wall has few points there, while many points of a surface across its nearer end lie within `split_m`. They
    turn its fitted line, so that the angle seems larger.
    """
    first, last, ax, ay = spans[w, 0], spans[w, 1], walls[w, ALONG_X], walls[w, ALONG_Y]
    length = ax * (v.x[last] - v.x[first]) + ay * (v.y[last] - v.y[first])
    if length > SHORT_M:
        return False
    far, step = (last, -1) if v.ranges[v.beam[last]] > v.ranges[v.beam[first]] else (first, 1)
    i = far
    while first <= i + step <= last and 2.0 * abs(ax * (v.x[i] - v.x[far]) + ay * (v.y[i] - v.y[far])) < length:
        i += step
    dx, dy, x, y = v.x[far] - v.x[i], v.y[far] - v.y[i], v.x[far] + v.x[i], v.y[far] + v.y[i]
    away: bool = abs(x * dy - y * dx) < graze_sine * math.sqrt((dx * dx + dy * dy) * (x * x + y * y))
    return away


@kernel
def _off_line(v: View, i: int, walls: F64x2, w: int) -> float:
    """Return the distance of point i from the line of wall `w`, positive on the robot's side."""
    off: float = walls[w, ALONG_X] * (v.y[i] - walls[w, Y]) - walls[w, ALONG_Y] * (v.x[i] - walls[w, X])
    robot = walls[w, ALONG_Y] * walls[w, X] - walls[w, ALONG_X] * walls[w, Y]
    return off if robot >= 0.0 else -off


@kernel
def _outermost(v: View, walls: F64x2, w: int, at: int, step: int, line_m: float) -> int:
    """Return the last point on the wall's line, from the wall's end `at` in the direction of `step`."""
    i = at
    for _ in range(SLACK_POINTS):
        if abs(_off_line(v, i, walls, w)) <= line_m:
            break
        i -= step
    while True:
        j = i + step
        if j < 0 or j >= len(v.x) or v.new_run[max(i, j)] or abs(_off_line(v, j, walls, w)) > line_m:
            return i
        i = j


@kernel
def next_beam(v: View, beam: int, step: int) -> int:
    """Return the next beam with a reading, or -1."""
    n = len(v.ranges)
    for _ in range(1 + SILENT_BEAMS):
        beam += step
        if v.full_turn:
            beam %= n
        if beam < 0 or beam >= n:
            return -1
        if not np.isnan(v.ranges[beam]):
            return beam
    return -1


@kernel
def _turns_back(v: View, limits: Limits, walls: F64x2, w: int, i: int, step: int) -> bool:
    """Return True if the surface continues behind the line of the wall that ends at point i."""
    j = i + step
    if _off_line(v, j, walls, w) > -limits.line_m:
        return False
    k = j + step
    if 0 <= k < len(v.x) and not v.new_run[max(j, k)]:
        return _off_line(v, k, walls, w) < -limits.line_m
    # A single point may be a mix of two surfaces: it counts only in front of something farther away.
    there = next_beam(v, v.beam[j], step)
    return there >= 0 and bool(v.ranges[there] > v.ranges[v.beam[j]] + limits.jump_m)


@kernel
def _slides(v: View, limits: Limits, walls: F64x2, w: int, i: int, step: int) -> bool:
    """Return True if the surface leaves the line of the wall gradually before point i, as round objects do."""
    ax, ay, p = walls[w, ALONG_X], walls[w, ALONG_Y], i
    while 0 < p < len(v.x) - 1 and _off_line(v, p, walls, w) < -ROUND * limits.line_m:
        p -= step
    tail = abs(ax * (v.x[i] - v.x[p]) + ay * (v.y[i] - v.y[p]))
    gap = abs(ax * (v.x[p] - v.x[p - step]) + ay * (v.y[p] - v.y[p - step])) if 0 <= p - step < len(v.x) else 0.0
    fall = _off_line(v, p, walls, w) - _off_line(v, i, walls, w)
    slides: bool = tail > gap + max(fall, SHARP * limits.line_m)
    return slides


@kernel
def _edge(v: View, limits: Limits, walls: F64x2, w: int, at: int, step: int) -> tuple[bool, Edge]:
    """Return (True if there is one, (x, y, beam)) of the edge at which wall `w` ends in the direction of `step`."""
    nothing = (False, (0.0, 0.0, 0.0))
    ranges, cosines, sines, x, y = v.ranges, v.cosines, v.sines, v.x, v.y
    i = _outermost(v, walls, w, at, step, limits.line_m)
    ax, ay = walls[w, ALONG_X], walls[w, ALONG_Y]
    if _slides(v, limits, walls, w, i, step):
        return nothing
    j = i + step
    if 0 <= j < len(x) and not v.new_run[max(i, j)]:
        # The surface continues off the line: another face of a pillar or jamb, or clutter in front of the wall.
        if not _turns_back(v, limits, walls, w, i, step) or _grazes(x[i], y[i], walls, w, limits.graze_sine):
            return nothing
        if abs(ax * (x[j] - x[i]) + ay * (y[j] - y[i])) > limits.edge_error_m:
            return nothing
        along = ax * (x[i] - walls[w, X]) + ay * (y[i] - walls[w, Y])
        return True, (walls[w, X] + along * ax, walls[w, Y] + along * ay, float(v.beam[i]) + 0.5 * step)
    here = v.beam[i]
    there = next_beam(v, here, step)
    if there < 0:
        return nothing
    # Range at which the next beam would hit this wall if it continued.
    offset = ax * walls[w, Y] - ay * walls[w, X]
    across = ax * sines[there] - ay * cosines[there]
    on_wall = offset / across if offset * across > 0.0 else ranges[here]
    if on_wall > v.range_max_m - limits.jump_m or ranges[there] < max(on_wall, ranges[here]) + limits.jump_m:
        return nothing
    # At a flat angle the next beam may hit the same wall much farther than computed, but still near its line.
    if abs(ranges[there] * across - offset) <= limits.line_m:
        return nothing
    # The edge lies between both beams, half a beam after the last point.
    ray_x, ray_y = cosines[here] + cosines[there], sines[here] + sines[there]
    across = ax * ray_y - ay * ray_x
    if offset * across <= 0.0 or _grazes(ray_x, ray_y, walls, w, limits.graze_sine):
        return nothing
    edge_x, edge_y = ray_x * (offset / across), ray_y * (offset / across)
    dx, dy = edge_x - x[i], edge_y - y[i]
    if 2.0 * abs(ax * dx + ay * dy) > limits.edge_error_m:
        return nothing
    return True, (edge_x, edge_y, float(here) + 0.5 * step)


@kernel
def _distance(ax: float, ay: float, bx: float, by: float) -> float:
    return math.sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by))


@kernel
def _bend(v: View, limits: Limits, walls: F64x2, spans: I64x2, w: int) -> tuple[bool, float, float, float]:
    """Return (True if walls w and w + 1 meet, x, y of their crossing, sine of the angle between them)."""
    last, first = spans[w, 1], spans[w + 1, 0]
    crossing_x, crossing_y, sine = line_crossing(walls, w, w + 1)
    meets = (
        not np.any(v.new_run[last + 1 : first + 1])
        and _distance(crossing_x, crossing_y, v.x[last], v.y[last]) <= limits.corner_gap_m
        and _distance(crossing_x, crossing_y, v.x[first], v.y[first]) <= limits.corner_gap_m
    )
    return meets, crossing_x, crossing_y, sine


@kernel
def _store(corners: F64x2, row: int, at: Edge, before: int, after: int, convex: float) -> int:
    corners[row, CORNER_X], corners[row, CORNER_Y], corners[row, BEAM] = at
    corners[row, BEFORE], corners[row, AFTER], corners[row, CONVEX] = float(before), float(after), convex
    return row + 1


@kernel
def corners_of(v: View, limits: Limits, walls: F64x2, spans: I64x2) -> F64x2:
    """Return (c, 6) corners, ordered by bearing. Source: Encoded graphs Alg. 1 (getCv, getCx), §V-A."""
    corners = np.empty((2 * len(walls), 6))
    found = 0
    crosses_before = False
    # Round objects look like short walls, whose ends change with the point of view.
    is_round, is_flat = np.zeros(len(walls) + 1, np.bool_), np.zeros(len(walls) + 1, np.bool_)
    for w in range(len(walls)):
        is_round[w] = bulge(v.x, v.y, walls, spans, w) > ROUND * limits.line_m
        is_flat[w] = _runs_away(v, walls, spans, w, limits.graze_sine)
    for w in range(len(walls)):
        if not (crosses_before or is_round[w] or is_flat[w]):
            is_one, edge = _edge(v, limits, walls, w, spans[w, 0], -1)
            if is_one:
                found = _store(corners, found, edge, -1, w, 0.0)
        crosses_before = False
        if w + 1 < len(walls):
            crosses_before, crossing_x, crossing_y, sine = _bend(v, limits, walls, spans, w)
            # Next to a wall seen at a flat angle the other wall ends at its own last point.
            crosses_before = crosses_before and is_flat[w] == is_flat[w + 1]
            seen_flat = (
                is_flat[w]
                or _grazes(crossing_x, crossing_y, walls, w, limits.graze_sine)
                or _grazes(crossing_x, crossing_y, walls, w + 1, limits.graze_sine)
            )
            rounded = sine < 0.0 and (is_round[w] or is_round[w + 1])
            if crosses_before and abs(sine) >= limits.corner_sine and not (seen_flat or rounded):
                at = 0.5 * float(v.beam[spans[w, 1]] + v.beam[spans[w + 1, 0]])
                found = _store(corners, found, (crossing_x, crossing_y, at), w, w + 1, 1.0 if sine > 0.0 else 0.0)
        if not (crosses_before or is_round[w] or is_flat[w]):
            is_one, edge = _edge(v, limits, walls, w, spans[w, 1], 1)
            if is_one:
                found = _store(corners, found, edge, w, -1, 0.0)
    return corners[:found]
