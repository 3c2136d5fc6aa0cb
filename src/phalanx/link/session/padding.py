"""Padding of plaintexts to few sizes, so that a record's length does not tell a turn from a stop."""

from __future__ import annotations

from phalanx.errors import TooLarge, UsageError
from phalanx.wire import MalformedRecord
from phalanx.wire.sessions import PADDED

SIZES = (128, 512, 2048)  # then multiples of the last


def padded_size(length: int) -> int:
    """Return the size of the plaintext that holds a content of `length` bytes."""
    whole, last = length + PADDED.size, SIZES[-1]
    return next((size for size in SIZES if whole <= size), -(-whole // last) * last)


def pad(content: bytes, most: int) -> bytes:
    """Return the plaintext of a content. Raises: UsageError: it is longer than `most` bytes with its padding."""
    size = padded_size(len(content))
    if size > most:
        raise UsageError(f"message of {len(content)} bytes, limit {most - PADDED.size}", "send less at once")
    return PADDED.encode(length=len(content), content=content + bytes(size - PADDED.size - len(content)))


def unpad(plaintext: bytes) -> bytes:
    """Return the content. Raises: MalformedRecord: it has another size than it would be padded to, or other padding."""
    fields = PADDED.decode(plaintext)
    length, content = fields["length"], fields["content"]
    if length > len(content) or padded_size(length) != len(plaintext) or any(content[length:]):
        raise MalformedRecord("not padded as it should be")
    return bytes(content[:length])


def check_size(raw: bytes, most: int) -> None:
    """Raise TooLarge for more than `most` bytes."""
    if len(raw) > most:
        raise TooLarge(f"{len(raw)} bytes, limit {most}")
