"""Convert a run into lines for a page that plays it, from a recording or live.

Each line is an object. The first has the run's metadata. Each other one is a time `t`, s, with positions, tokens,
compromised robots, completed audits and events; and with additions to the map.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity

from phalanx.errors import PhalanxError, UsageError
from phalanx.recording.recorded import CUT_SHORT, Said, read_recording
from phalanx.recording.recorder import NS
from phalanx.scenarios.scenario import Scenario

from .recording import Recording

log = logging.getLogger(__name__)
HINT = "create one with phalanx sim run SCENARIO --record FILE.mcap"
GRAIN_S = 0.1  # least time between lines; recordings of missions have many steps per second
MOST_VALUES = 2_500_000  # positions, tokens, audits: a browser's limit; 25 robots for an hour
FARTHEST_M = 1e6
LONGEST = 120  # length of a text
MOST_DRAWN = 100_000  # objects per message: two bytes may encode a disc, and a disc gives CORNERS walls
CORNERS = 16  # walls that approximate a disc
ABOUT = ("name", "seed", "defence", "duration_s", "tokens_needed", "t_val_ms")
_ROBOT = re.compile(r"robot-(\d{1,6})", re.ASCII)
_VERDICT = re.compile(r"(?:gives|refuses) a token to robot (\d{1,6})(?:: (.*))?", re.ASCII | re.DOTALL)

Line = dict[str, Any]


def lines_of(path: Path) -> list[Line]:
    """Return a recording's lines, up to a page's limit.

    Raises: UsageError: not a recording, or one without robots' positions. Unavailable: it cannot be read.
    """
    lines: list[Line] = []
    scenes = Scenes(lines.append)
    try:
        for entry in read_recording(path, HINT):
            if entry.topic == CUT_SHORT:
                log.warning("%s is truncated: only the first part is shown", path)
            scenes.take(entry)
            if scenes.told > MOST_VALUES:
                log.warning("%s exceeds a page's limit: the end is not shown", path)
                break
        scenes.close()
    except PhalanxError:
        raise
    except Exception as error:  # an invalid position, a text for a number
        raise UsageError(f"{path} is not a recording of phalanx", HINT) from error
    if scenes.t_s is None:
        raise UsageError(f"{path} has no positions of robots", HINT)
    return lines


class Live(Recording):
    """Live stream of the lines that a recording of the run would give."""

    def __init__(self, scenario: Scenario, put: Callable[[Line], None]) -> None:
        super().__init__(Path(), scenario)
        self._scenes = Scenes(put)
        self._scenes.take(Said("metadata scenario", 0, self.about()))
        self.put("/scene", 0, self._ground())

    def put(self, topic: str, t_ns: int, message: Any) -> None:
        """Process a message like one of a recording."""
        self._scenes.take(Said(topic, t_ns, message))

    def end(self) -> None:
        """Finish the last line."""
        self._scenes.close()


class Scenes:
    """Converter of recorded messages into lines, passed to `put`. Invalid messages raise various exceptions."""

    def __init__(self, put: Callable[[Line], None]) -> None:
        self.told = 0  # size of the lines so far, for MOST_VALUES
        self.t_s: float | None = None  # time of the current line
        self._put = put
        self._about = False  # the metadata were sent
        self._at: dict[int, tuple[int, int, int]] = {}  # x mm, y mm, heading in degrees
        self._lies: dict[int, str] = {}
        self._step: Line = {}

    def take(self, entry: Said) -> None:
        """Process the next message."""
        match entry.topic:
            case "metadata scenario" if not self._about:
                self._about = True
                self._put({"about": {key: str(entry.words[key])[:LONGEST] for key in ABOUT if key in entry.words}})
            case "/tf":
                self._move(entry.t_ns / NS, entry.words.transforms)
            case "/scene":
                drawn = [
                    (each.cylinders, each.cubes, *(line.points for line in each.lines)) for each in entry.words.entities
                ]
                if sum(len(things) for each in drawn for things in each) > MOST_DRAWN:
                    raise ValueError(MOST_DRAWN)
                for entity in entry.words.entities:
                    self._draw(entity)
            case "/shields":
                self._step.pop("shields", None)
                shields = [_shield(each) for each in entry.words["robots"]]
                self._add("shields", shields)
                self.told += sum(len(tokens) for *_, tokens in shields)
            case "/log":
                self._log(entry.t_ns / NS, entry.words)

    def close(self) -> None:
        """Finish the current line."""
        if self.t_s is None:
            return  # earlier messages belong to the first line
        at = [[rob_id, *place] for rob_id, place in self._at.items()]
        self.told += len(at) + len(self._lies)
        self._put({"t": self.t_s, "at": at, "lies": list(self._lies.items()), **self._step})
        self._step = {}

    def _add(self, key: str, rows: list[Any]) -> None:
        self._step.setdefault(key, []).extend(rows)
        self.told += len(rows)

    def _move(self, t_s: float, frames: Iterable[Any]) -> None:
        if self.t_s is None or t_s - self.t_s >= GRAIN_S:
            self.close()
            self.t_s = t_s
        for frame in frames:
            if name := _ROBOT.fullmatch(frame.child_frame_id):
                turned = math.degrees(2 * math.atan2(frame.rotation.z, frame.rotation.w))
                place = _mm(frame.translation.x), _mm(frame.translation.y)
                self._at[int(name[1])] = *place, round(turned)

    def _draw(self, entity: SceneEntity) -> None:
        discs = [(c.pose.position.x, c.pose.position.y, c.size.x / 2) for c in entity.cylinders]
        if name := _ROBOT.fullmatch(entity.id):
            for pair in entity.metadata:
                if pair.key == "attack" and pair.value:
                    self._lies[int(name[1])] = pair.value[:LONGEST]
            return
        walls = []
        if entity.id == "ground":
            marks, walls = discs[:1], [wall for disc in discs[1:] for wall in _around(*disc)]
            for cube in entity.cubes:
                at, size = cube.pose.position, cube.size
                around = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
                walls += _closed([(at.x + i * size.x, at.y + j * size.y) for i, j in around])
        else:
            marks = discs
            for line in entity.lines:
                ends = [(point.x, point.y) for point in line.points]
                walls += [(*a, *b) for a, b in zip(ends[::2], ends[1::2], strict=False)]
        self._add("marks", [[_mm(x), _mm(y)] for x, y, _ in marks])
        self._add("walls", [[_mm(each) for each in wall] for wall in walls])

    def _log(self, t_s: float, entry: Log) -> None:
        name = _ROBOT.fullmatch(entry.name)
        if not name:
            return
        if verdict := _VERDICT.fullmatch(entry.message):
            self._add("audits", [[t_s, int(name[1]), int(verdict[1]), (verdict[2] or "")[:LONGEST]]])
        elif entry.level >= Log.INFO:
            self._add("events", [[t_s, int(name[1]), entry.message[:LONGEST]]])


def _shield(robot: Any) -> list[Any]:
    tokens = [[int(each["auditor"]), _within(each["left_s"], FARTHEST_M)] for each in robot["tokens"]]
    return [int(robot["id"]), bool(robot["safe_mode"]), tokens]


def _mm(length_m: float) -> int:
    return round(1000 * _within(length_m, FARTHEST_M))


def _within(value: float, most: float) -> float:
    if not -most <= value <= most:
        raise ValueError(value)
    return float(value)


def _around(x_m: float, y_m: float, radius_m: float) -> list[tuple[float, float, float, float]]:
    turns = [2 * math.pi * k / CORNERS for k in range(CORNERS)]
    return _closed([(x_m + radius_m * math.cos(turn), y_m + radius_m * math.sin(turn)) for turn in turns])


def _closed(corners: list[tuple[float, float]]) -> list[tuple[float, float, float, float]]:
    return [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
