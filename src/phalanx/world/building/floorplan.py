"""Load floor plans by name or file: built-in ones, our YAML files, and maps of ROS's map_server.

Packages add others by an entry point of the group `phalanx.buildings`: `drawn:7` is loaded by the entry point `drawn`.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from phalanx.config.builtin import DATA, built_in
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError, did_you_mean
from phalanx.mission.landmarks.floorplan import FILE_MAX_BYTES, FloorPlan, floorplan_of_yaml, read_yaml, sources_of
from phalanx.mission.landmarks.gridmap import CELLS_MAX, floorplan_of_map, parse_map_header

MAPS = DATA / "maps"
DEFAULT = "office_40x40"
HINT = "use a map's YAML file with its picture in the same folder"
_PICTURE_MAX_BYTES = 2 * CELLS_MAX + 4096
GROUP = "phalanx.buildings"


def load_floorplan(name_or_path: str | Path = DEFAULT, *, swept: bool = False) -> FloorPlan:
    """Return a floor plan: a built-in map by name, one of another package (`drawn:7`), or a YAML file.

    The picture of a map_server map is in the folder of its YAML file, optionally compressed (.gz). `swept` removes the
    noise in such a map, for authoring and judging missions.
    Raises: UsageError: no such map, or an invalid file. Unavailable: it cannot be read.
    """
    kind, colon, _ = str(name_or_path).partition(":")
    for point in entry_points(group=GROUP, name=kind) if colon else ():
        plan: FloorPlan = point.load()(str(name_or_path))
        return plan
    path = Path(name_or_path)
    if not path.suffix:
        path = MAPS / f"{path.name}.yaml"
        if not path.exists():
            known = built_in("maps")
            like = drawn_like(str(name_or_path))
            near = f"did you mean {like}? " if like else did_you_mean(path.stem, known)
            seeds = "".join(f"{each}:SEED, " for each in sorted(entry_points(group=GROUP).names))
            hint = f"{near}use a YAML file, {seeds}or {', '.join(known)}"
            raise UsageError(f"there is no map {str(name_or_path)!r}", hint)
    data = read_at_most(path, FILE_MAX_BYTES, HINT)
    read = read_yaml(data, path.name)
    return replace(_drawn_in(path, data, read, swept), sources=sources_of(read, path.name))


def _drawn_in(path: Path, data: bytes, read: Mapping[Any, Any], swept: bool) -> FloorPlan:
    if "image" not in read:
        return floorplan_of_yaml(data, path.stem)
    image = path.parent / parse_map_header(data, path.name).image
    packed = image.with_name(image.name + ".gz")
    picture = (
        _unpack(packed) if packed.exists() and not image.exists() else read_at_most(image, _PICTURE_MAX_BYTES, HINT)
    )
    return floorplan_of_map(data, picture, path.stem, swept=swept)


def drawn_like(name: str) -> str:
    """Suggest the name of a generated building for a misspelt one, such as `drawn:7` for `drwn:7`; or return ""."""
    kind, colon, rest = name.partition(":")
    known = entry_points(group=GROUP).names if colon else ()
    return next((f"{each}:{rest}" for each in known if did_you_mean(kind, (each,))), "")


def _unpack(path: Path) -> bytes:
    try:
        with gzip.open(path) as file:
            data = file.read(_PICTURE_MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    if len(data) > _PICTURE_MAX_BYTES:
        raise UsageError(f"{path} unpacks to more than {_PICTURE_MAX_BYTES} bytes")
    return data
