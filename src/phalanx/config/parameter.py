"""A parameter is declared once: its default, its limits, and what the schema of scenario files says of it."""

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
    """Metadata of a dataclass's field: what the schema of scenario files says of it."""
    return {"description": words}


def described(default: Thing, words: str) -> Thing:
    """Return a field with a default, and with words for the schema."""
    made: Thing = field(default=default, metadata=description(words))
    return made


def within(default: Number, low: float, high: float, words: str = "") -> Number:
    """A field that holds a number from `low` to `high`; see `check_limits`."""
    limited: Number = field(default=default, metadata={"within": (low, high), **description(words)})
    return limited


def check_limits(config: Any) -> None:
    """Nothing, if each field of a dataclass is `within` its limits. Raises: UsageError: one is not."""
    for each in fields(config):
        if "within" in each.metadata:
            check_within(each.name, getattr(config, each.name), *each.metadata["within"])


def limits_in(kind: Any, name: str) -> tuple[float, float]:
    """Return the limits of a dataclass's field that is `within` some."""
    limits: tuple[float, float] = next(each for each in fields(kind) if each.name == name).metadata["within"]
    return limits


def check_within(name: str, value: float, low: float, high: float) -> None:
    """Nothing, if a number is from `low` to `high`. Raises: UsageError: it is not, or is none."""
    if not isinstance(value, Real):
        raise UsageError(f"{name} is {value!r}", "a number")
    if not low <= value <= high:  # NaN too
        raise UsageError(f"{name} is {_words(value)}", f"{_words(low)} to {_words(high)}")


def made_once(make: Callable[[Thing], Made]) -> Callable[[Thing], Made]:
    """Return `make` with a cache by identity: to hash thirty fields takes longer than most that is made of them."""
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
    """Nothing, if that is a public Ed25519 key, or "" for nobody's. Raises: UsageError."""
    if key and not (len(key) == KEY_DIGITS and set(key) <= set(string.hexdigits)):
        raise UsageError(f"{name} is {key[:KEY_DIGITS]!r}", "64 hexadecimal digits: phalanx keys list")


def _words(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
