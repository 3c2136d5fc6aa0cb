"""Declaration of parameters: default, limits, and description for the schema of scenario files."""

from __future__ import annotations

import string
from collections.abc import Callable, Mapping
from dataclasses import field, fields
from functools import wraps
from numbers import Real
from typing import Any, TypeVar

from phalanx.errors import UsageError

Number = TypeVar("Number", int, float)
Thing = TypeVar("Thing")
Made = TypeVar("Made")
MADE_MOST = 1024
KEY_DIGITS = 64


def description(words: str) -> Mapping[str, Any]:
    """Return metadata of a dataclass field with its description in the schema of scenario files."""
    return {"description": words}


def described(default: Thing, words: str) -> Thing:
    """Return a dataclass field with a default and a description for the schema."""
    made: Thing = field(default=default, metadata=description(words))
    return made


def within(default: Number, low: float, high: float, words: str = "") -> Number:
    """Return a dataclass field for a number from `low` to `high`; `check_limits` checks it."""
    limited: Number = field(default=default, metadata={"within": (low, high), **description(words)})
    return limited


def check_limits(config: Any) -> None:
    """Check all fields of a dataclass that are declared by `within`. Raises: UsageError: one is out of range."""
    for each in fields(config):
        if "within" in each.metadata:
            check_within(each.name, getattr(config, each.name), *each.metadata["within"])


def limits_in(kind: Any, name: str) -> tuple[float, float]:
    """Return the limits of a dataclass field that is declared by `within`."""
    limits: tuple[float, float] = next(each for each in fields(kind) if each.name == name).metadata["within"]
    return limits


def check_within(name: str, value: float, low: float, high: float) -> None:
    """Check that a value is a number from `low` to `high`. Raises: UsageError: it is not."""
    if not isinstance(value, Real):
        raise UsageError(f"{name} is {value!r}", "a number")
    if not low <= value <= high:  # NaN too
        raise UsageError(f"{name} is {_format(value)}", f"{_format(low)} to {_format(high)}")


def made_once(make: Callable[[Thing], Made]) -> Callable[[Thing], Made]:
    """Return `make` with a cache by identity: hashing a config of thirty fields would cost more than most calls."""
    known: dict[int, tuple[Thing, Made]] = {}

    @wraps(make)
    def made(thing: Thing) -> Made:
        found = known.get(id(thing))
        if found is None or found[0] is not thing:
            if len(known) >= MADE_MOST:
                known.clear()
            found = known[id(thing)] = thing, make(thing)
        return found[1]

    return made


def check_key(name: str, key: str) -> None:
    """Check that a key is a public Ed25519 key in hexadecimal, or "" for none. Raises: UsageError: it is not."""
    if key and not (len(key) == KEY_DIGITS and set(key) <= set(string.hexdigits)):
        raise UsageError(
            f"{name} is {key[:KEY_DIGITS]!r}", "use 64 hexadecimal digits, as phalanx keys list prints them"
        )


def _format(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
