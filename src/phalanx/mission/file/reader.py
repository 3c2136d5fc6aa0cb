"""Reading little-endian fields out of untrusted bytes: a value or `MalformedMission`, never more than is there."""

from __future__ import annotations

from typing import Any

from phalanx.mission.refused import MalformedMission
from phalanx.wire import Record


class Reader:
    """A place in bytes that moves forward."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.at = 0

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return len(self.raw) - self.at

    def take(self, count: int) -> bytes:
        """The next `count` bytes."""
        if count > self.left:
            raise MalformedMission(f"{count} bytes wanted at {self.at}, {self.left} left")
        self.at += count
        return self.raw[self.at - count : self.at]

    def unpack(self, record: Record) -> tuple[Any, ...]:
        """The next record's fixed part."""
        return record.form.unpack(self.take(record.size))

    def number(self, record: Record) -> int:
        """The next record's one number: a count, or what begins with it."""
        (number,) = self.unpack(record)
        return int(number)

    def behind(self, length: Record) -> bytes:
        """Bytes behind a length."""
        return self.take(self.number(length))

    def end(self) -> None:
        """Nothing may follow."""
        if self.left:
            raise MalformedMission(f"{self.left} bytes too many")


def text_of(raw: bytes) -> str:
    """UTF-8. Raises: MalformedMission."""
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise MalformedMission("a text is not UTF-8") from error
