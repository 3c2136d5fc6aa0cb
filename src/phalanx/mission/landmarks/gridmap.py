"""Read maps of ROS's map_server (a PGM image and a YAML file) as floor plans.

All cells that are not free stop a laser: walls, cells between both thresholds, and unknown cells. Their contour is
followed along the edges of the cells, with free space on the left, and cut into straight pieces by the same split and
merge as a scan. Landmarks come only from parts of the contour along walls.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import BOOLx1, F64x1, F64x2, I64x1, U8x2
from phalanx.config.lidar import ExtractionConfig
from phalanx.errors import UsageError
from phalanx.kernel import kernel

from .corners import line_crossing
from .floorplan import PASS_M, FloorPlan, extraction_of, numbers, read_yaml, start_pose
from .outlines import Outline, ways_around
from .walls import fit_line, split_run

CELLS_MAX = 50_000_000
FREE, UNKNOWN, WALL = 0, 1, 2
# Grey value of unknown cells, as saved by map_saver.
UNKNOWN_GREY = 205
# Largest deviation from a straight wall, in cells: an oblique wall has steps of one cell.
SPLIT_CELLS = 1.5
# Specks of a few cells are noise of the mapping: they stop rays, but have no corners.
SPECK_CELLS = 8
# Largest edge of a cell that counts as a speck of dust.
DUST_M = 0.1
# Number of positions of a robot on the circle around a speck, PASS_M from the speck and from everything else.
PLACES = 24
_PGM = re.compile(
    rb"P([25])\s(?:\s*#[^\n]*\n)*\s*(\d{1,6})\s+(?:#[^\n]*\n\s*)*(\d{1,6})\s+(?:#[^\n]*\n\s*)*(\d{1,5})\s"
)


@dataclass(frozen=True, slots=True)
class MapHeader:
    """Content of a map_server YAML file."""

    image: str  # name of the image file, in the same folder
    resolution_m: float  # edge of a cell
    origin: tuple[float, float, float]  # x, y, rotation of the lower left cell, map frame
    negate: bool  # True if bright cells are occupied
    occupied: float  # probability from which a cell is a wall
    free: float  # probability below which a cell is free
    # x, y, heading of the robots' start (start_pose, an extension of the format), or None
    start: tuple[float, float, float] | None = None
    extraction: ExtractionConfig = ExtractionConfig()  # noqa: RUF009  # frozen; from door_width, also an extension


def parse_map_header(data: bytes, name: str) -> MapHeader:
    """Parse a map_server YAML file.

    Raises: UsageError: it is invalid. Source: ROS map_server, nav2_map_server.
    """
    content = read_yaml(data, name)
    image = content.get("image")
    if not isinstance(image, str) or not image:
        raise UsageError(f"{name} names no image", "add image: FILE.pgm")
    (resolution,) = numbers([content.get("resolution")], f"{name}: resolution", 1)
    (occupied,) = numbers([content.get("occupied_thresh", 0.65)], f"{name}: occupied_thresh", 1)
    (free,) = numbers([content.get("free_thresh", 0.196)], f"{name}: free_thresh", 1)
    if not 0.001 <= resolution <= 10 or not 0 <= free < occupied <= 1:
        problem = f"{name}: resolution {resolution}, thresholds {free} and {occupied}"
        raise UsageError(problem, "use 0.001 to 10 metres, and thresholds from 0 to 1 with free below occupied")
    x, y, turn = numbers(content.get("origin", [0.0, 0.0, 0.0]), f"{name}: origin", 3)
    negate = bool(content.get("negate", 0))
    start, extraction = start_pose(content, name), extraction_of(content, name)
    return MapHeader(image, resolution, (x, y, turn), negate, occupied, free, start, extraction)


def read_pgm(data: bytes, name: str) -> NDArray[np.uint8]:
    """Return (height, width) grey values 0..255 of an image, the first row on top.

    Raises: UsageError: not a PGM image (P5 or P2). Source: netpbm's pgm(5).
    """
    head = _PGM.match(data)
    if head is None:
        raise UsageError(f"{name} is not a PGM image", "use P5 or P2, as saved by map_server")
    width, height, top = int(head[2]), int(head[3]), int(head[4])
    if not 0 < width * height <= CELLS_MAX or not 0 < top < 65536:
        raise UsageError(f"{name} is {width} x {height} with values up to {top}", f"use up to {CELLS_MAX} cells")
    body = data[head.end() :]
    if head[1] == b"2":
        try:
            values = np.array(body.split()[: width * height], dtype=np.int64)
        except (ValueError, OverflowError) as error:
            raise UsageError(f"{name} has a value that is not a number") from error
    else:
        values = np.frombuffer(
            body, ">u2" if top > 255 else "u1", count=min(width * height, len(body) // (1 + (top > 255)))
        )
    if len(values) < width * height:
        raise UsageError(f"{name} ends after {len(values)} of {width * height} cells")
    if values.min() < 0 or values.max() > top:
        raise UsageError(f"{name} has values above its maximum of {top}")
    grey = values.astype(np.float64) * (255.0 / top)
    return np.rint(grey).astype(np.uint8).reshape(height, width)


def cells_of(grey: NDArray[np.uint8], header: MapHeader) -> NDArray[np.uint8]:
    """Return (height + 2, width + 2) cells FREE, UNKNOWN or WALL, the first row at the bottom, with a border."""
    occupied = (grey if header.negate else 255 - grey.astype(np.int64)) / 255.0
    cells = np.full(grey.shape, WALL, np.uint8)
    cells[(grey == UNKNOWN_GREY) & (occupied <= header.occupied)] = UNKNOWN
    cells[occupied < header.free] = FREE
    # The border of solid cells closes every contour.
    return np.pad(cells[::-1], 1, constant_values=UNKNOWN)


def floorplan_of_map(yaml_data: bytes, pgm_data: bytes, name: str, *, swept: bool = False) -> FloorPlan:
    """Return the floor plan of a map_server map; with `swept`, without dust (see `without_dust`).

    Raises: UsageError: one of the files is invalid.
    """
    header = parse_map_header(yaml_data, name)
    drawn = cells_of(read_pgm(pgm_data, header.image), header)
    cells, dust = without_dust(drawn, header.resolution_m) if swept else (drawn, 0)
    height, width = cells.shape[0] - 2, cells.shape[1] - 2
    outlines = _outlines(cells, header)
    frame = _to_map(np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]), header)
    (x0, y0), (x1, y1) = frame.min(0).tolist(), frame.max(0).tolist()
    return FloorPlan(
        name,
        _walls(outlines),
        _of_one_space(outlines, header),
        (x0, y0, x1, y1),
        header.start,
        extraction=header.extraction,
        dust=dust,
        drawn=_walls(_outlines(drawn, header)) if dust else None,
    )


def _outlines(cells: NDArray[np.uint8], header: MapHeader) -> list[Outline]:
    points, starts, of_wall = _contours(cells)
    outlines = []
    for first, stop in pairwise(starts.tolist()):
        corners, seen = _straight(points[first:stop], of_wall[first:stop])
        outlines.append(Outline(_to_map(corners - 1.0, header), seen))
    return outlines


def _walls(outlines: list[Outline]) -> NDArray[np.float64]:
    walls = [np.hstack([outline.points, np.roll(outline.points, -1, axis=0)]) for outline in outlines]
    return np.vstack([np.zeros((0, 4)), *walls])


def _of_one_space(outlines: list[Outline], header: MapHeader) -> tuple[Outline, ...]:
    """Return the outlines of the space with the start, or of the largest, without specks and unreachable spaces."""
    speck_m2 = SPECK_CELLS * header.resolution_m * header.resolution_m
    large = {id(outline.points): outline for outline in outlines if abs(outline.area_m2) > speck_m2}
    rooms = [outline for outline in large.values() if outline.area_m2 > 0]
    if header.start is not None:
        x, y, _ = header.start
        home = min((room for room in rooms if room.has_on_free_side(x, y)), key=lambda o: o.area_m2, default=None)
    else:
        home = max(rooms, key=lambda o: o.area_m2, default=None)
    if home is None:
        return ()
    kept = ways_around([outline.points for outline in large.values()], home.points)
    return tuple(large[id(points)] for points in kept)


def _to_map(points: NDArray[np.float64], header: MapHeader) -> NDArray[np.float64]:
    x, y, turn = header.origin
    cosine, sine = math.cos(turn), math.sin(turn)
    scaled = points * header.resolution_m
    return np.stack(
        [x + cosine * scaled[:, 0] - sine * scaled[:, 1], y + sine * scaled[:, 0] + cosine * scaled[:, 1]], 1
    )


@kernel
def _contours(cells: U8x2) -> tuple[F64x2, I64x1, BOOLx1]:  # noqa: C901  # a single traversal
    """Follow the borders of all cells that are not free, with free space on the left.

    Returns: (n, 2) midpoints of cells' edges, in cells; (contours + 1,) first point of each contour; (n,) True if the
        cell on the right is a wall.
    """
    height, width = cells.shape
    # Directions: 0 +x, 1 +y, 2 -x, 3 -y. An edge leaves the lattice point (column, row) in a direction.
    done = np.zeros((height + 1, width + 1, 4), np.bool_)
    total = 0
    for row in range(height):
        for column in range(width):
            if cells[row, column] != FREE:
                total += 4
    points = np.empty((total, 2))
    of_wall = np.empty(total, np.bool_)
    starts = np.empty(total // 4 + 2, np.int64)
    count, contours = 0, 0
    step_x, step_y = (1, 0, -1, 0), (0, 1, 0, -1)
    # The solid cell on the right and the free one on the left of an edge, from its lattice point.
    right_x, right_y = (0, 0, -1, -1), (-1, 0, 0, -1)
    left_x, left_y = (0, -1, -1, 0), (0, 0, -1, -1)
    for row in range(height):
        for column in range(width):
            # Every contour has an edge below a solid cell, walked towards -x.
            if cells[row, column] == FREE or row == 0 or cells[row - 1, column] != FREE:
                continue
            x, y, way = column + 1, row, 2
            if done[y, x, way]:
                continue
            starts[contours] = count
            contours += 1
            while not done[y, x, way]:
                done[y, x, way] = True
                points[count, 0] = x + 0.5 * step_x[way]
                points[count, 1] = y + 0.5 * step_y[way]
                of_wall[count] = cells[y + right_y[way], x + right_x[way]] == WALL
                count += 1
                x += step_x[way]
                y += step_y[way]
                # Cells that touch at a corner are one wall: turn left if possible, else go straight, else turn right.
                for turn in (1, 0, 3):
                    onward = (way + turn) % 4
                    if (
                        cells[y + right_y[onward], x + right_x[onward]] != FREE
                        and cells[y + left_y[onward], x + left_x[onward]] == FREE
                    ):
                        way = onward
                        break
    starts[contours] = count
    return points[:count], starts[: contours + 1], of_wall[:count]


def _straight(points: NDArray[np.float64], of_wall: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the corners of a contour, in cells, as crossings of its fitted lines; and a mask of pieces of wall."""
    # Start at a corner: the point farthest from the centre is one, and the point farthest from that is another.
    first = _farthest(points, points.mean(0))
    order = np.append(np.roll(np.arange(len(points)), -first), first)
    x, y = points[order].T.copy()
    return _pieces(x, y, of_wall[order], _farthest(points[order], points[first]))


def _farthest(points: NDArray[np.float64], place: NDArray[np.float64]) -> int:
    return int(np.argmax(((points - place) ** 2).sum(1)))


@kernel
def _pieces(x: F64x1, y: F64x1, of_wall: BOOLx1, middle: int) -> tuple[F64x2, BOOLx1]:
    """Return the corners of a closed contour, and True for each if the piece after it is a wall.

    The last point equals the first. The contour is cut there and at `middle`, as a closed chord has no direction.
    """
    last = len(x) - 1
    starts = np.empty(len(x) + 1, np.int64)
    pieces = split_run(x, y, 0, middle, SPLIT_CELLS, starts)
    pieces += split_run(x, y, middle, last, SPLIT_CELLS, starts[pieces:])
    starts[pieces] = last
    corners = np.empty((pieces, 2))
    seen = np.empty(pieces, np.bool_)
    lines = np.empty((pieces, 4))
    for p in range(pieces):
        first, end = starts[p], starts[p + 1]
        trim = 2 if end - first >= 10 else (1 if end - first >= 6 else 0)
        lines[p, 0], lines[p, 1], lines[p, 2], lines[p, 3] = fit_line(x, y, first + trim, end - trim)
        bordering = 0
        for i in range(first, end):
            if of_wall[i]:
                bordering += 1
        seen[p] = 2 * bordering > end - first
    for p in range(pieces):
        i, before = starts[p], (p - 1) % pieces
        corners[p, 0], corners[p, 1] = x[i], y[i]
        crossing_x, crossing_y, sine = line_crossing(lines, before, p)
        if abs(sine) >= 0.3 and abs(crossing_x - x[i]) + abs(crossing_y - y[i]) < 2.0:
            corners[p, 0], corners[p, 1] = crossing_x, crossing_y
    return corners, seen


def without_dust(cells: NDArray[np.uint8], edge_m: float) -> tuple[NDArray[np.uint8], int]:
    """Return the cells of a map with lone cells that a robot can drive around made free; and their number.

    SLAM leaves single black cells from reflections and passers-by. A survey that took each for a pillar would find no
    way. But a lone cell may also be the leg of a chair, so cells that narrow a passage are kept. The survey and the
    audit of a mission use the cleaned map, the simulation of a building does not.
    """
    if edge_m > DUST_M:
        return cells, 0
    solid = cells != FREE
    around = sum(np.roll(solid, (i, j), (0, 1)).astype(np.uint8) for i in (-1, 0, 1) for j in (-1, 0, 1))
    lone = solid & (around == 1)
    dust = [(i, j) for i, j in np.argwhere(lone).tolist() if _is_passed(solid, i, j, edge_m)]
    swept = cells.copy()
    for i, j in dust:
        swept[i, j] = FREE
    return swept, len(dust)


def _is_passed(solid: NDArray[np.bool_], row: int, column: int, edge_m: float) -> bool:
    """Return True if a robot can drive from each place beside a speck to each other, so that it separates none."""
    away = PASS_M / edge_m + 0.5  # in cells, from a robot's centre to the centres of the cells that it passes
    reach = math.ceil(2 * away)
    window = solid[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
    others = np.argwhere(window) - (min(row, reach), min(column, reach))
    others = others[np.any(others != 0, axis=1)]
    turns = math.tau * np.arange(PLACES) / PLACES
    y, x = away * np.sin(turns), away * np.cos(turns)
    nearest = np.hypot(y[:, None] - others[:, 0], x[:, None] - others[:, 1]).min(axis=1, initial=np.inf)
    has_room = nearest >= away
    gaps = int(np.count_nonzero(has_room & ~np.roll(has_room, 1)))
    return bool(has_room.all() or (gaps == 1 and has_room.any()))
