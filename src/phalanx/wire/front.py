"""Messages between a front end and its gateway: a header, then as many bytes as it states.

The gateway does not trust the front end: it checks each header and each length.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum

from .record import MalformedRecord, record

NUMBERS_MAX = 2**32 - 1  # largest number of a connection

FRONT_HEAD = record(
    "front_head: before each message between a front end and its gateway",
    "length u32: bytes that follow",
    "kind u8: see FromFront and ToFront",
    "number u32: number of a connection; for `publish` and `taken`, how many numbers follow",
)


class FromFront(IntEnum):
    """Message kinds from a front end."""

    OPENED = 1  # a client's address, ASCII
    RECEIVED = 2  # a message of that client
    CLOSED = 3
    ALIVE = 4  # the answer to a probe


class ToFront(IntEnum):
    """Message kinds from a gateway."""

    SEND = 65  # a message for one client
    PUBLISH = 66  # numbers of connections, and a message for all of them
    CLOSE = 67  # a reason, ASCII
    ADMITTED = 68
    TAKEN = 69  # messages processed: for each, in order, the processing time in µs
    PROBE = 70


def pack_numbers(numbers: Sequence[int]) -> bytes:
    """Encode numbers as u32."""
    return struct.pack(f"<{len(numbers)}I", *numbers)


def unpack_numbers(raw: bytes, count: int) -> tuple[tuple[int, ...], bytes]:
    """Decode `count` u32; return them and the bytes after them. Raises: MalformedRecord: there are fewer."""
    size = 4 * count
    if len(raw) < size:
        raise MalformedRecord(f"{count} numbers in {len(raw)} bytes")
    return struct.unpack_from(f"<{count}I", raw), raw[size:]
