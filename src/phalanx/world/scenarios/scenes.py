"""A run as lines that a page plays: what a recording says, step by step, whether it is a file or goes on just now.

Each line is an object. The first has the run's name and what a token is worth; each other a moment `t`, s: where
robots are, what shields they have, who lies, audits that ended, what happened; and of the ground what is new.
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
HINT = "phalanx sim run SCENARIO --record FILE.mcap makes one"
GRAIN_S = 0.1  # of missions each step is recorded: many a second
MOST_TOLD = 2_500_000  # places, shields, tokens, audits: what a browser keeps without effort; 25 robots for an hour
FARTHEST_M = 1e6
LONGEST = 120  # of a text
MOST_DRAWN = 100_000  # things of a message: two bytes may be a disc, and a disc CORNERS walls
CORNERS = 16  # of a disc, as walls
ABOUT = ("name", "seed", "defence", "duration_s", "tokens_needed", "t_val_ms")
_ROBOT = re.compile(r"robot-(\d{1,6})", re.ASCII)
_VERDICT = re.compile(r"(?:gives|refuses) a token to robot (\d{1,6})(?:: (.*))?", re.ASCII | re.DOTALL)

Line = dict[str, Any]


def lines_of(path: Path) -> list[Line]:
    """A recording's lines, as many as a page keeps.

    Raises: UsageError: it is no recording, or none of robots that have places. Unavailable: it cannot be read.
    """
    lines: list[Line] = []
    scenes = Scenes(lines.append)
    try:
        for said in read_recording(path, HINT):
            if said.topic == CUT_SHORT:
                log.warning("%s was cut short: it is shown up to there", path)
            scenes.take(said)
            if scenes.told > MOST_TOLD:
                log.warning("%s is longer than a page keeps: the end is left out", path)
                break
        scenes.close()
    except PhalanxError:
        raise
    except Exception as error:  # a place that is none, a text for a number
        raise UsageError(f"{path} is not as phalanx writes recordings", HINT) from error
    if scenes.t_s is None:
        raise UsageError(f"{path} has no robots' places", HINT)
    return lines


class Live(Recording):
    """Live stream of the scene that a recording of the run would hold."""

    def __init__(self, scenario: Scenario, put: Callable[[Line], None]) -> None:
        super().__init__(Path(), scenario)
        self._scenes = Scenes(put)
        self._scenes.take(Said("metadata scenario", 0, self.about()))
        self.put("/scene", 0, self._ground())

    def put(self, topic: str, t_ns: int, message: Any) -> None:
        """A message."""
        self._scenes.take(Said(topic, t_ns, message))

    def end(self) -> None:
        """Nothing more comes."""
        self._scenes.close()


class Scenes:
    """Makes lines of messages, and puts each line where it is told. What it raises says that they are not as ours."""

    def __init__(self, put: Callable[[Line], None]) -> None:
        self.told = 0  # so much so far
        self.t_s: float | None = None  # of the step that is being told
        self._put = put
        self._about = False  # it was told
        self._at: dict[int, tuple[int, int, int]] = {}  # x mm, y mm, heading in degrees
        self._lies: dict[int, str] = {}
        self._step: Line = {}

    def take(self, said: Said) -> None:
        """The next message."""
        match said.topic:
            case "metadata scenario" if not self._about:
                self._about = True
                self._put({"about": {key: str(said.words[key])[:LONGEST] for key in ABOUT if key in said.words}})
            case "/tf":
                self._move(said.t_ns / NS, said.words.transforms)
            case "/scene":
                drawn = [
                    (each.cylinders, each.cubes, *(line.points for line in each.lines)) for each in said.words.entities
                ]
                if sum(len(things) for each in drawn for things in each) > MOST_DRAWN:
                    raise ValueError(MOST_DRAWN)
                for entity in said.words.entities:
                    self._draw(entity)
            case "/shields":
                self._step.pop("shields", None)
                shields = [_shield(each) for each in said.words["robots"]]
                self._add("shields", shields)
                self.told += sum(len(tokens) for *_, tokens in shields)
            case "/log":
                self._say(said.t_ns / NS, said.words)

    def close(self) -> None:
        """The step that was begun is over."""
        if self.t_s is None:
            return  # what came before the first step is in it
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

    def _say(self, t_s: float, entry: Log) -> None:
        name = _ROBOT.fullmatch(entry.name)
        if not name:
            return
        if verdict := _VERDICT.fullmatch(entry.message):
            self._add("audits", [[t_s, int(name[1]), int(verdict[1]), (verdict[2] or "")[:LONGEST]]])
        elif entry.level >= Log.INFO:
            self._add("events", [[t_s, int(name[1]), entry.message[:LONGEST]]])


def _shield(words: Any) -> list[Any]:
    tokens = [[int(each["auditor"]), _within(each["left_s"], FARTHEST_M)] for each in words["tokens"]]
    return [int(words["id"]), bool(words["safe_mode"]), tokens]


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
