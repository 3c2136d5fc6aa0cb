"""Reading little-endian fields out of untrusted bytes: a value or `MalformedMission`, never more than is there."""

from __future__ import annotations

import struct

from phalanx.mission.refused import MalformedMission


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

    def unpack(self, form: struct.Struct) -> tuple[int, ...]:
        """The next fields of a struct of integers."""
        return form.unpack(self.take(form.size))

    def number(self, size: int) -> int:
        """The next unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def short(self) -> bytes:
        """Bytes behind a length of one byte."""
        return self.take(self.number(1))

    def long(self) -> bytes:
        """Bytes behind a length of two bytes."""
        return self.take(self.number(2))

    def end(self) -> None:
        """Nothing may follow."""
        if self.left:
            raise MalformedMission(f"{self.left} bytes too many")


def text_of(raw: bytes) -> str:
    """UTF-8.

    Raises: MalformedMission.
    """
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise MalformedMission("a text is not UTF-8") from error
