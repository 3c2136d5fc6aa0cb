"""Requests for audits cut into their parts and put together again: other tokens, start of the log or segment."""

from __future__ import annotations

import struct

from caught import MARKS

from phalanx.bti import log, request
from phalanx.bti.log import ENTRY_HEAD_BYTES

CHECKED = bytes([log.CHECKPOINT])


def segment_at(q: bytes) -> int:
    return len(q) - int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little")


def with_segment(q: bytes, segment: bytes) -> bytes:
    """The request with another segment."""
    head = bytearray(q[: segment_at(q)])
    head[request.AT_SEGMENT_LEN : request.AT_SEGMENT_LEN + 4] = len(segment).to_bytes(4, "little")
    return bytes(head) + segment


def parts(segment: bytes) -> list[bytes]:
    found, at = [], 0
    while at < len(segment):
        size = 1 if segment[at] in MARKS else ENTRY_HEAD_BYTES + int.from_bytes(segment[at + 5 : at + 7], "little")
        found.append(segment[at : at + size])
        at += size
    return found


def tokens(q: bytes) -> list[bytes]:
    at = [request.HEAD_BYTES + k * request.TOKEN_BYTES for k in range(q[request.AT_TOKENS])]
    return [q[each : each + request.TOKEN_BYTES] for each in at]


def with_tokens(q: bytes, shown: list[bytes]) -> bytes:
    head = bytearray(q[: request.HEAD_BYTES])
    head[request.AT_TOKENS] = len(shown)
    return bytes(head) + b"".join(shown) + q[start_at(q) :]


def entry(kind: int, t_ms: int, payload: bytes) -> bytes:
    """As a node would have made it."""
    return struct.pack("<BIH", kind, t_ms, len(payload)) + payload


def start_at(q: bytes) -> int:
    return request.HEAD_BYTES + q[request.AT_TOKENS] * request.TOKEN_BYTES


def start_of(q: bytes) -> bytes:
    return q[start_at(q) :][: int.from_bytes(q[request.AT_CHECKPOINT_LEN :][:2], "little")]


def with_start(q: bytes, start: bytes) -> bytes:
    """The request with another start of its log."""
    at = start_at(q)
    head = bytearray(q[:at])
    head[request.AT_CHECKPOINT_LEN : request.AT_CHECKPOINT_LEN + 2] = len(start).to_bytes(2, "little")
    return bytes(head) + start + q[at + len(start_of(q)) :]


def with_byte(q: bytes, at: int, value: int) -> bytes:
    return q[:at] + bytes([value]) + q[at + 1 :]


def shown_of(auditee, edit) -> int:
    """The verdict on a true request whose segment's parts `edit` has changed."""
    auditor, q = auditee.asks()
    return auditee.verdict((auditor, with_segment(q, b"".join(edit(parts(q[segment_at(q) :]))))))
