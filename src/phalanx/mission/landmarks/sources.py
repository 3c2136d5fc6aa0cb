"""What robots' other sensors tell of: radio beacons, and quantities that are above a level, as gas, heat or light.

In a map's YAML file, of either kind:

    beacons: [{id: uwb-7, at: [9.0, 12.0], range: 3.0, noise: 0.1}]
    quantities: [{reading: gas, at: [24.0, 31.0], peak: 90, half: 1.5, over: 30, noise: 2}]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from phalanx.config.parameter import check_limits, within
from phalanx.errors import UsageError

READING_MAX_BYTES = 64
SOURCES_MAX = 1000
LARGEST = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Beacon:
    """A radio beacon. Robots measure how far off it is, through walls, and read its id while that is within its range.

    Bluetooth is one with much noise, UWB one with little. Source: Encoded graphs §IV-A.
    """

    reading: str
    x_m: float = within(0.0, -LARGEST, LARGEST)  # map frame
    y_m: float = within(0.0, -LARGEST, LARGEST)
    range_m: float = within(3.0, 0.1, 1000.0)
    noise_m: float = within(0.1, 0.0, 100.0)  # standard deviation of a distance

    stopped_by_walls = False

    def __post_init__(self) -> None:
        check_limits(self)

    def is_read(self, away_m: float, chance: float) -> bool:
        """Whether it is read from so far off, by a standard normal number."""
        return away_m + self.noise_m * chance <= self.range_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Something that is strongest at its place, and that robots read of where they measure more than a level of it.

    Half of it is left `half_m` off, a fifth twice as far; walls keep it.
    """

    reading: str
    x_m: float = within(0.0, -LARGEST, LARGEST)  # map frame
    y_m: float = within(0.0, -LARGEST, LARGEST)
    peak: float = within(100.0, 0.0, LARGEST)  # in whatever unit, like level and noise
    half_m: float = within(1.0, 0.01, 1000.0)
    over: float = within(50.0, 0.0, LARGEST)
    noise: float = within(1.0, 0.0, LARGEST)  # standard deviation of what is measured

    stopped_by_walls = True

    def __post_init__(self) -> None:
        check_limits(self)
        if self.over >= self.peak:
            raise UsageError(f"over {self.over:g} of a peak of {self.peak:g}", "below the peak, or nobody reads it")

    def is_read(self, away_m: float, chance: float) -> bool:
        """Whether it is read from so far off, by a standard normal number."""
        halves = away_m / self.half_m
        return self.peak / (1.0 + halves * halves) + self.noise * chance >= self.over


Source = Beacon | Quantity
# What the file calls the fields.
_BEACON = {"id": "reading", "range": "range_m", "noise": "noise_m"}
_QUANTITY = {"reading": "reading", "peak": "peak", "half": "half_m", "over": "over", "noise": "noise"}


def sources_of(words: Mapping[Any, Any], name: str) -> tuple[Source, ...]:
    """The beacons and quantities of a map's file.

    Raises: UsageError: they are something else; the message says where.
    """
    beacons = (_source(Beacon, _BEACON, each, where) for where, each in _listed(words, "beacons", name))
    quantities = (_source(Quantity, _QUANTITY, each, where) for where, each in _listed(words, "quantities", name))
    return *beacons, *quantities


def _listed(words: Mapping[Any, Any], key: str, name: str) -> list[tuple[str, Any]]:
    value = words.get(key) or []
    if not isinstance(value, list) or len(value) > SOURCES_MAX:
        raise UsageError(f"{name}: {key} is no list of them", f"at most {SOURCES_MAX}; docs/maps.md shows them")
    return [(f"{name}: {key}, number {i + 1}", each) for i, each in enumerate(value)]


def _source(kind: Callable[..., Source], known: Mapping[str, str], words: Any, where: str) -> Source:
    given = dict(words) if isinstance(words, dict) else {}
    place = given.pop("at", None)
    told = {known.get(key, ""): value for key, value in given.items()}
    reading = told.pop("reading", None)
    is_reading = isinstance(reading, str) and 0 < len(reading.encode(errors="replace")) <= READING_MAX_BYTES
    if "" in told or not is_reading or not isinstance(place, list) or len(place) != 2:
        raise UsageError(f"{where}, is {words!r:.80}", f"at: [x, y], {', '.join(known)}")
    try:
        return kind(reading=reading, x_m=place[0], y_m=place[1], **told)
    except UsageError as error:
        raise UsageError(f"{where}: {error}", error.hint) from error
