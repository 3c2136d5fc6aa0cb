"""Floor plans by name: out of files, ours in YAML and ROS's map_server maps, of which some come with the package; and
buildings that chance has drawn.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from phalanx.config.builtin import DATA, built_in
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError, did_you_mean
from phalanx.mission.landmarks.floorplan import FILE_MAX_BYTES, FloorPlan, floorplan_of_yaml, read_yaml
from phalanx.mission.landmarks.gridmap import CELLS_MAX, floorplan_of_map, map_words
from phalanx.mission.landmarks.sources import sources_of

from .drawn import PREFIX, drawn

MAPS = DATA / "maps"
DEFAULT = "office_40x40"
HINT = "a map's YAML file, and beside it the picture that it names"
_PICTURE_MAX_BYTES = 2 * CELLS_MAX + 4096


def load_floorplan(name_or_path: str | Path = DEFAULT, *, swept: bool = False) -> FloorPlan:
    """A floor plan by the name of a built-in map, of a drawn building (`drawn:7`), or from a YAML file.

    Args:
        name_or_path: the picture of a map_server map lies beside its YAML file, as it is or compressed (.gz).
        swept: without the dust of such a map, for who makes missions of it or judges them.
    Raises: UsageError: there is no such map, or it is none; the message says why. Unavailable: it cannot be read.
    """
    if str(name_or_path).startswith(PREFIX):
        return drawn(str(name_or_path))
    path = Path(name_or_path)
    if not path.suffix:
        path = MAPS / f"{path.name}.yaml"
        if not path.exists():
            known = built_in("maps")
            like = drawn_like(str(name_or_path))
            near = f"did you mean {like}? " if like else did_you_mean(path.stem, known)
            hint = f"{near}a YAML file, {PREFIX}SEED, or {', '.join(known)}"
            raise UsageError(f"there is no map {str(name_or_path)!r}", hint)
    words = read_at_most(path, FILE_MAX_BYTES, HINT)
    read = read_yaml(words, path.name)
    return replace(_drawn_in(path, words, read, swept), sources=sources_of(read, path.name))


def _drawn_in(path: Path, words: bytes, read: Mapping[Any, Any], swept: bool) -> FloorPlan:
    if "image" not in read:
        return floorplan_of_yaml(words, path.stem)
    image = path.parent / map_words(words, path.name).image
    packed = image.with_name(image.name + ".gz")
    picture = (
        _unpack(packed) if packed.exists() and not image.exists() else read_at_most(image, _PICTURE_MAX_BYTES, HINT)
    )
    return floorplan_of_map(words, picture, path.stem, swept=swept)


def drawn_like(name: str) -> str:
    """What a name was perhaps meant to be of drawn buildings, as `drawn:7` for `drwn:7`; or nothing."""
    kind, colon, rest = name.partition(":")
    return PREFIX + rest if colon and did_you_mean(kind, (PREFIX[:-1],)) else ""


def _unpack(path: Path) -> bytes:
    try:
        with gzip.open(path) as file:
            data = file.read(_PICTURE_MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    if len(data) > _PICTURE_MAX_BYTES:
        raise UsageError(f"{path} unpacks to more than {_PICTURE_MAX_BYTES} bytes")
    return data
