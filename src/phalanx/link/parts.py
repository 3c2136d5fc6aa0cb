"""Answers in parts: a list too long for one small message travels as several, and arrives as one.

Small messages matter: mosquitto 2.0, the broker of most labs, sends a browser about 4 KB per 100 ms of any longer one.

Source: docs/adr/0009.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from phalanx.errors import BadPayload

from .envelope import encode_json

# Together with MAX_PART_BYTES they bound what a hostile server can make us keep: 64 MiB.
MAX_PARTS = 1024
MAX_OPEN = 4
MAX_PART_BYTES = 16 * 1024  # sealed


def split_list(data: Sequence[Any], limit_bytes: int) -> list[list[Any]]:
    """Split `data` into pieces of at most `limit_bytes` of JSON, or one element. Raises: ValueError, TypeError."""
    pieces: list[list[Any]] = [[]]
    used = 0
    for element in data:
        size = len(encode_json(element)) + 1
        if pieces[-1] and used + size > limit_bytes:
            pieces.append([])
            used = 0
        pieces[-1].append(element)
        used += size
    return pieces


@dataclass(slots=True)
class _Open:
    parts: int
    got: dict[int, list[Any]] = field(default_factory=dict)


class PartsInbox:
    """Puts answers together again, a few at a time; the oldest unfinished one is forgotten first."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], _Open] = {}

    def take(self, number: int, words: dict[str, Any]) -> list[Any] | None:
        """Return the list of `data` once its last part is here, else None. Raises: BadPayload."""
        answer, part, parts, data = (words.get(key) for key in ("answer", "part", "parts", "data"))
        if type(answer) is not int or type(part) is not int or type(parts) is not int or not isinstance(data, list):
            raise BadPayload("a part of an answer has whole numbers 'answer', 'part' and 'parts', and a list")
        if not (1 <= parts <= MAX_PARTS and 0 <= part < parts):
            raise BadPayload("a part that cannot be")
        key = (number, answer)
        unfinished = self._open.setdefault(key, _Open(parts))
        if unfinished.parts != parts:
            raise BadPayload("an answer that changes its number of parts")
        unfinished.got[part] = data
        if len(unfinished.got) == parts:
            del self._open[key]
            return [element for i in range(parts) for element in unfinished.got[i]]
        while len(self._open) > MAX_OPEN:
            del self._open[next(iter(self._open))]
        return None
