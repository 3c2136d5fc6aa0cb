"""Read mission files (plain, encoded, start keys), and parse the options of missions."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

from phalanx.cli.credentials import read_trusted
from phalanx.config.builtin import built_in
from phalanx.config.lidar import ExtractionConfig
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError, did_you_mean
from phalanx.mission import (
    EncodedMission,
    Mission,
    Profile,
    StartKey,
    check_signature,
    parse_mission,
    parse_start_key,
)
from phalanx.mission.authoring.document import WrittenMission
from phalanx.mission.authoring.findable import mark_lookalikes_in
from phalanx.mission.file.records import FILE_LIMIT, FOREVER_S, OPEN_START
from phalanx.mission.landmarks.floorplan import FloorPlan
from phalanx.mission.refused import MalformedMission
from phalanx.world.building.floorplan import drawn_like, load_floorplan
from phalanx.world.missions.orders import File

Parsed = TypeVar("Parsed")
TEXT_LIMIT = 32 << 20
MAGIC = b"PHXM"
ENDING = ".phxm"


def read_plain(source: str) -> Mission:
    """Return a plain mission, from a file or bundled; the path of its map is relative to it. Raises: UsageError."""
    known = built_in("missions")
    wanted = _hint(source, "a mission's YAML file")
    data = read_at_most(known.get(source, Path(source)), TEXT_LIMIT, wanted)
    if data.startswith(MAGIC):
        raise UsageError(f"{source} is already encoded", "give the plain mission from which it was built")
    written = WrittenMission(data, source)
    words = written.words
    if words is None:
        raise UsageError(f"{source} is empty", wanted)
    if isinstance(words, dict) and "nodes" not in words and words.keys() & {"walls", "image"}:
        hint = f"use --map {source} with build, and --world {source} to run a mission"
        raise UsageError(f"{source} is a map, not a mission", hint)
    mission = written.mission()
    if Path(mission.floor_plan).suffix:  # a file, not a bundled map
        mission = replace(mission, floor_plan=str(Path(source).parent / mission.floor_plan))
    try:
        return mark_lookalikes_in(load_floorplan(mission.floor_plan), mission) if mission.floor_plan else mission
    except UsageError:
        return mission  # a missing map is reported where it is needed


def read_encoded(path: Path) -> EncodedMission:
    """Return an encoded mission. Raises: UsageError: the file is unreadable. PeerError: it is malformed."""
    wanted = "use a file that phalanx mission build wrote"
    if str(path) in built_in("missions"):
        wanted = f"first run phalanx mission build {path} --out FILE, then use FILE"
    return _built(path, wanted, "an encoded mission", parse_mission)


def read_start_key(path: Path) -> StartKey:
    """Return a start key. Raises: UsageError: the file is unreadable. PeerError: it is malformed."""
    return _built(path, "use the .key file that phalanx mission build wrote", "a start key", parse_start_key)


def _built(path: Path, hint: str, what: str, parse: Callable[[bytes], Parsed]) -> Parsed:
    data = read_at_most(path, FILE_LIMIT, hint)
    if not data:
        raise MalformedMission(f"{path} is empty")
    try:
        return parse(data)
    except MalformedMission as error:
        raise MalformedMission(f"{path} is not {what}: {error}") from error


def parse_window(text: str) -> tuple[int, int]:
    """Return FROM/TO in seconds on the mission's clock; either may be a date, or empty. Raises: UsageError."""
    begin, slash, end = text.partition("/")
    if not slash:
        raise UsageError(f"invalid period {text!r}", "use FROM/TO, like 2026-12-01T08:00/2026-12-01T18:00")
    return _second(begin, 0), _second(end, FOREVER_S)


def _second(text: str, otherwise: int) -> int:
    if not text:
        return otherwise
    if text.isdecimal():
        return int(text)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise UsageError(f"invalid time {text!r}", "use seconds, or a date like 2026-12-01T08:00 (UTC)") from error
    return int((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp())


def parse_robots(text: str) -> tuple[int, ...]:
    """Return the robot ids in 1,2,7 or 1-5. Raises: UsageError."""
    out: list[int] = []
    for part in text.split(","):
        if not (match := re.fullmatch(r"\s*(\d{1,5})(?:-(\d{1,5}))?\s*", part)):
            raise UsageError(f"invalid robot id {part!r}", "use ids like 1,2,7 or 1-5")
        first, last = int(match[1]), int(match[2] or match[1])
        # An empty list would allow all robots.
        if not 1 <= first <= last <= 65_535:
            raise UsageError(f"invalid robot ids {part.strip()}", "use ids from 1 to 65535, the lower first")
        out += range(first, last + 1)
    return tuple(out)


def parse_box(text: str) -> tuple[float, float, float, float]:
    """Return X0,Y0,X1,Y1 in metres. Raises: UsageError."""
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UsageError(f"invalid area {text!r}", "use X0,Y0,X1,Y1 in metres, like 0,0,40,40") from error
    if not (-1e5 < x0 < x1 < 1e5 and -1e5 < y0 < y1 < 1e5):
        raise UsageError(f"invalid area {text!r}", "use X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1")
    return x0, y0, x1, y1


def check_folder(out: Path) -> None:
    """Check that the folder of an output file exists. Raises: UsageError."""
    if not out.absolute().parent.exists():
        raise UsageError(f"no folder {out.parent}", "create it first")


def _hint(source: str, wanted: str) -> str:
    """Return the hint for a missing mission; the name may be a building's."""
    if building := source if source in built_in("maps") else drawn_like(source):
        return f"for a building: phalanx mission build --map {building} --out FILE, then FILE with --world {building}"
    known = built_in("missions")
    return f"{did_you_mean(source, known)}{wanted}, or one of {', '.join(known)}"


def is_encoded(source: str) -> bool:
    """Return whether FILE|BUILTIN is, or should be, an encoded mission. Raises: UsageError: it does not exist."""
    known = built_in("missions")
    if source in known:
        return False
    data = read_at_most(Path(source), FILE_LIMIT, _hint(source, "a mission's file"))
    return data.startswith(MAGIC) or (bool(data) and Path(source).suffix == ENDING)


def start_key_of(path: Path, encoded: EncodedMission, given: Path | None, option: str) -> StartKey | None:
    """Return the start key, given or beside the file. Raises: UsageError: a sealed mission has none."""
    beside = path.with_name(path.name + ".key")
    if given is not None or beside.exists():
        return read_start_key(given or beside)
    if encoded.header.profile is Profile.SEALED and not encoded.header.flags & OPEN_START:
        raise UsageError(f"{path} needs its start key", f"use {option} FILE, or put {beside.name} beside it")
    return None


@dataclass(frozen=True, slots=True)
class Wanted:
    """Missions selected by options: the encoded files of all parts with their keys, or a plain one."""

    sources: tuple[str, ...]
    furnish: str | None  # the plain mission of the files
    key: Path | None  # start key of a single file
    trust: tuple[str, ...]  # public keys of trusted signers
    key_option: str  # name of the option for `key`

    def read(self) -> tuple[list[File], Mission | None]:
        """Read the encoded files and the plain mission. Raises: UsageError: unreadable; PeerError: invalid."""
        encoded = bool(self.sources) and is_encoded(self.sources[0])
        if not encoded and (self.key is not None or self.trust or self.furnish):
            words = f"{self.key_option}, --trust and --furnish are for encoded missions"
            raise UsageError(words, "build one: phalanx mission build")
        if encoded:
            if self.key is not None and len(self.sources) > 1:
                words = f"{self.key_option} for {len(self.sources)} files"
                raise UsageError(words, f"put each start key beside its file, as FILE{ENDING}.key")
            paths = [Path(each) for each in self.sources]
            missions = [read_encoded(path) for path in paths]
            keys = [start_key_of(*each, self.key, self.key_option) for each in zip(paths, missions, strict=True)]
            for mission in missions:
                if self.trust or mission.signer:
                    check_signature(mission, [read_trusted(key) for key in self.trust] or None)
            files = list(zip(missions, keys, strict=True))
            return files, read_plain(self.furnish) if self.furnish else None
        if len(self.sources) > 1:
            raise UsageError("several plain missions", "give one plain mission, or the encoded files of all its parts")
        return [], read_plain(self.sources[0]) if self.sources else None


def building(name: str, doors: str | None, *, swept: bool = False) -> FloorPlan:
    """Return a floor plan with the doors of --door-width, optionally without dust. Raises: UsageError: no such plan."""
    plan = load_floorplan(name, swept=swept)
    return plan if doors is None else replace(plan, extraction=doors_of(doors))


def doors_of(text: str) -> ExtractionConfig:
    """Return the scan settings for doors of --door-width. Raises: UsageError: invalid widths."""
    try:
        least, most = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"--door-width {text!r}", "use LEAST,MOST in metres, like 0.7,1.3") from None
    return ExtractionConfig(door_min_m=least, door_max_m=most)
