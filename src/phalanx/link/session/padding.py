"""Padding of plaintexts to a few sizes, so that the length of a record does not reveal the command in it."""

from __future__ import annotations

from phalanx.errors import TooLarge, UsageError
from phalanx.wire import MalformedRecord
from phalanx.wire.sessions import PADDED

SIZES = (128, 512, 2048)  # bytes; then multiples of the last


def padded_size(length: int) -> int:
    """Return the size of the plaintext for a content of `length` bytes."""
    whole, last = length + PADDED.size, SIZES[-1]
    return next((size for size in SIZES if whole <= size), -(-whole // last) * last)


def pad(content: bytes, most: int) -> bytes:
    """Pad a content. Raises: UsageError: the plaintext is longer than `most` bytes."""
    size = padded_size(len(content))
    if size > most:
        raise UsageError(f"message of {len(content)} bytes, limit {most - PADDED.size}", "send less at once")
    return PADDED.encode(length=len(content), content=content + bytes(size - PADDED.size - len(content)))


def unpad(plaintext: bytes) -> bytes:
    """Remove the padding. Raises: MalformedRecord: not the size that `pad` chooses, or padding that is not zero."""
    fields = PADDED.decode(plaintext)
    length, content = fields["length"], fields["content"]
    if length > len(content) or padded_size(length) != len(plaintext) or any(content[length:]):
        raise MalformedRecord("wrong padding")
    return bytes(content[:length])


def check_size(raw: bytes, most: int) -> None:
    """Raise TooLarge if `raw` has more than `most` bytes."""
    if len(raw) > most:
        raise TooLarge(f"{len(raw)} bytes, limit {most}")
