"""Define the messages between a front end and its gateway: a header, then as many bytes as it states.

Nobody else reads these bytes. The gateway does not trust the front end: it checks each head and each length.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum

from .record import MalformedRecord, record

NUMBERS_MAX = 2**32 - 1  # of connections

FRONT_HEAD = record(
    "front_head: before each message between a front end and its gateway",
    "length u32: of what follows, bytes",
    "kind u8: see FromFront and ToFront",
    "number u32: of a connection; for `publish` and `taken` how many numbers follow",
)


class FromFront(IntEnum):
    """Message kinds from a front end."""

    OPENED = 1  # a client's address, ASCII
    RECEIVED = 2  # its message
    CLOSED = 3
    ALIVE = 4  # the answer to a probe


class ToFront(IntEnum):
    """Message kinds from a gateway."""

    SEND = 65  # a message for one client
    PUBLISH = 66  # numbers of connections, and a message for all of them
    CLOSE = 67  # a reason, ASCII
    ADMITTED = 68
    TAKEN = 69  # so many messages were processed; for each, in their order, how long that took in µs
    PROBE = 70


def pack_numbers(numbers: Sequence[int]) -> bytes:
    """Return the bytes of numbers."""
    return struct.pack(f"<{len(numbers)}I", *numbers)


def unpack_numbers(raw: bytes, count: int) -> tuple[tuple[int, ...], bytes]:
    """Return `count` numbers, and the bytes behind them. Raises: MalformedRecord: there are fewer."""
    size = 4 * count
    if len(raw) < size:
        raise MalformedRecord(f"{count} numbers in {len(raw)} bytes")
    return struct.unpack_from(f"<{count}I", raw), raw[size:]
