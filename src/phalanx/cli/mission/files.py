"""The files of missions: plain ones, encoded ones, start keys; and what options say in words."""

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
from phalanx.mission.authoring.findable import apart_in
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
    """A plain mission: a file's, or one that comes with Phalanx; a map in a file lies beside it. Raises: UsageError."""
    known = built_in("missions")
    wanted = _hint(source, "a mission's YAML file")
    data = read_at_most(known.get(source, Path(source)), TEXT_LIMIT, wanted)
    if data.startswith(MAGIC):
        raise UsageError(f"{source} is encoded already", "give the plain mission it was built from")
    written = WrittenMission(data, source)
    words = written.words
    if words is None:
        raise UsageError(f"{source} is empty", wanted)
    if isinstance(words, dict) and "nodes" not in words and words.keys() & {"walls", "image"}:
        hint = f"--map {source} is for build, and --world {source} where a mission runs"
        raise UsageError(f"{source} is a map, not a mission", hint)
    mission = written.mission()
    if Path(mission.floor_plan).suffix:  # a file, and no map that comes with Phalanx
        mission = replace(mission, floor_plan=str(Path(source).parent / mission.floor_plan))
    try:
        return apart_in(load_floorplan(mission.floor_plan), mission) if mission.floor_plan else mission
    except UsageError:
        return mission  # whoever needs the map says that it is not there


def read_encoded(path: Path) -> EncodedMission:
    """An encoded mission. Raises: UsageError: it cannot be read. PeerError: it is none."""
    wanted = "a file that phalanx mission build wrote"
    if str(path) in built_in("missions"):
        wanted = f"phalanx mission build {path} --out FILE first, then FILE"
    return _built(path, wanted, "an encoded mission", parse_mission)


def read_start_key(path: Path) -> StartKey:
    """A start key. Raises: UsageError: it cannot be read. PeerError: it is none."""
    return _built(path, "the .key file that phalanx mission build wrote", "a start key", parse_start_key)


def _built(path: Path, hint: str, what: str, parse: Callable[[bytes], Parsed]) -> Parsed:
    data = read_at_most(path, FILE_LIMIT, hint)
    if not data:
        raise MalformedMission(f"{path} is empty")
    try:
        return parse(data)
    except MalformedMission as error:
        raise MalformedMission(f"{path} is not {what}: {error}") from error


def parse_window(said: str) -> tuple[int, int]:
    """Return FROM/TO in seconds on the mission's clock; either may be a date, or nothing. Raises: UsageError."""
    begin, slash, end = said.partition("/")
    if not slash:
        raise UsageError(f"{said!r} is no window", "FROM/TO, like 2026-12-01T08:00/2026-12-01T18:00")
    return _second(begin, 0), _second(end, FOREVER_S)


def _second(said: str, otherwise: int) -> int:
    if not said:
        return otherwise
    if said.isdecimal():
        return int(said)
    try:
        moment = datetime.fromisoformat(said)
    except ValueError as error:
        raise UsageError(f"{said!r} is no time", "seconds, or a date like 2026-12-01T08:00 (UTC)") from error
    return int((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp())


def parse_robots(said: str) -> tuple[int, ...]:
    """Robot ids: 1,2,7 or 1-5. Raises: UsageError."""
    out: list[int] = []
    for part in said.split(","):
        if not (match := re.fullmatch(r"\s*(\d{1,5})(?:-(\d{1,5}))?\s*", part)):
            raise UsageError(f"{part!r} is no robot", "ids like 1,2,7 or 1-5")
        first, last = int(match[1]), int(match[2] or match[1])
        # An empty list would mean that anybody may run it.
        if not 1 <= first <= last <= 65_535:
            raise UsageError(f"robots {part.strip()}", "ids from 1 to 65535, the lower first")
        out += range(first, last + 1)
    return tuple(out)


def parse_box(said: str) -> tuple[float, float, float, float]:
    """X0,Y0,X1,Y1 in metres. Raises: UsageError."""
    try:
        x0, y0, x1, y1 = (float(part) for part in said.split(","))
    except ValueError as error:
        raise UsageError(f"{said!r} is no area", "X0,Y0,X1,Y1 in metres, like 0,0,40,40") from error
    if not (-1e5 < x0 < x1 < 1e5 and -1e5 < y0 < y1 < 1e5):
        raise UsageError(f"{said!r} is no area", "X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1")
    return x0, y0, x1, y1


def check_folder(out: Path) -> None:
    """Nothing, if there is a folder for the file that is to be made. Raises: UsageError: there is none."""
    if not out.absolute().parent.exists():
        raise UsageError(f"no folder {out.parent}", "make it first")


def _hint(source: str, wanted: str) -> str:
    """What to say instead of a mission that is not there: it may be a building's name."""
    if building := source if source in built_in("maps") else drawn_like(source):
        return f"a building: phalanx mission build --map {building} --out FILE, then FILE with --world {building}"
    known = built_in("missions")
    return f"{did_you_mean(source, known)}{wanted}, or one of {', '.join(known)}"


def is_encoded(source: str) -> bool:
    """Return whether FILE|BUILTIN is, or should be, an encoded mission's file. Raises: UsageError: there is neither."""
    known = built_in("missions")
    if source in known:
        return False
    data = read_at_most(Path(source), FILE_LIMIT, _hint(source, "a mission's file"))
    return data.startswith(MAGIC) or (bool(data) and Path(source).suffix == ENDING)


def start_key_of(path: Path, encoded: EncodedMission, given: Path | None, option: str) -> StartKey | None:
    """Return the start key that was given, or lies beside the file. Raises: UsageError: a sealed mission has none."""
    beside = path.with_name(path.name + ".key")
    if given is not None or beside.exists():
        return read_start_key(given or beside)
    if encoded.header.profile is Profile.SEALED and not encoded.header.flags & OPEN_START:
        raise UsageError(f"{path} needs its start key", f"{option} FILE, or {beside.name} beside it")
    return None


@dataclass(frozen=True, slots=True)
class Wanted:
    """Missions as options ask for them: the encoded files of all parts with what belongs to them, or a plain one."""

    sources: tuple[str, ...]
    furnish: str | None  # what the files were built from
    key: Path | None  # of one file
    trust: tuple[str, ...]  # whoever must have signed them
    key_option: str  # as people know it

    def read(self) -> tuple[list[File], Mission | None]:
        """Read the encoded files and the plain mission. Raises: UsageError: one is unreadable; PeerError: refused."""
        encoded = bool(self.sources) and is_encoded(self.sources[0])
        if not encoded and (self.key is not None or self.trust or self.furnish):
            words = f"{self.key_option}, --trust and --furnish are for encoded missions"
            raise UsageError(words, "phalanx mission build makes one")
        if encoded:
            if self.key is not None and len(self.sources) > 1:
                words = f"{self.key_option} for {len(self.sources)} files"
                raise UsageError(words, f"each with its start key beside it, FILE{ENDING}.key")
            paths = [Path(each) for each in self.sources]
            missions = [read_encoded(path) for path in paths]
            keys = [start_key_of(*each, self.key, self.key_option) for each in zip(paths, missions, strict=True)]
            for mission in missions:
                if self.trust or mission.signer:
                    check_signature(mission, [read_trusted(key) for key in self.trust] or None)
            files = list(zip(missions, keys, strict=True))
            return files, read_plain(self.furnish) if self.furnish else None
        if len(self.sources) > 1:
            words = "one that is not encoded, or the encoded files of all its parts"
            raise UsageError("several missions", words)
        return [], read_plain(self.sources[0]) if self.sources else None


def building(name: str, doors: str | None, *, swept: bool = False) -> FloorPlan:
    """Return a floor plan with doors as --door-width says, perhaps without dust. Raises: UsageError: no such plan."""
    plan = load_floorplan(name, swept=swept)
    return plan if doors is None else replace(plan, extraction=doors_of(doors))


def doors_of(said: str) -> ExtractionConfig:
    """How scans are read where doors are as wide as --door-width says. Raises: UsageError: no doors are."""
    try:
        least, most = map(float, said.split(","))
    except ValueError:
        raise UsageError(f"--door-width {said!r}", "like 0.7,1.3: metres") from None
    return ExtractionConfig(door_min_m=least, door_max_m=most)
