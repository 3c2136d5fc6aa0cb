"""The c-node's log: entries exactly as the trusted nodes chained them, in the order of processing, and marks.

A mark is one byte outside the chains. It shows the auditor where a chain was flushed before its batch was full, and
where the checkpoint was taken. Evidence may follow an INPUT. It is in no chain either, but the INPUT contains its hash
(docs/spec/rebound.md). Advice is logged at the point where the controller received it, and is not authenticated.

A log is stored in two arrays: a short front in memory shared with other logs' fronts, and the rest in sparse memory.
Code outside this file accesses logs only through `write`, `read` and `logged`.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire import guarded, table
from phalanx.wire.fields import Row, copy, get_u16, whole

from .fleet import Fleet

ENTRY_HEAD_BYTES = table.ENTRY_HEADER_BYTES
ENTRY_T, ENTRY_LENGTH = map(table.ENTRY.at, ("t", "payload"))
MARK = table.MARK
MARK_BYTES = table.CHECKED.size
FLUSH_S, FLUSH_A, CHECKPOINT = table.MARK_FLUSH_S, table.MARK_FLUSH_A, table.MARK_CHECKPOINT
EVIDENCE = table.MARK_EVIDENCE
EVIDENCE_HEAD_BYTES = table.EVIDENCE.size
EVIDENCE_LENGTH = table.EVIDENCE.at("bytes")
ADVICE = guarded.MARK_ADVICE
ADVICE_HEAD_BYTES = guarded.ADVICE.size
ADVICE_LENGTH = guarded.ADVICE.at("bytes")
CUT = -1  # in place of a kind: the entry is incomplete


@kernel
def piece_at(raw: Row, at: int, end: int) -> tuple[int, int, int]:
    """Parse the item at offset `at` of `raw[:end]`: an entry, a mark, evidence or advice.

    Returns: its kind, or CUT if it is incomplete; the offset of its payload, which is empty for a mark; its end.
    Source: docs/spec/rebound.md.
    """
    kind = whole(raw[at])
    head, length_at = ENTRY_HEAD_BYTES, ENTRY_LENGTH
    if kind == EVIDENCE:
        head, length_at = EVIDENCE_HEAD_BYTES, EVIDENCE_LENGTH
    elif kind == ADVICE:
        head, length_at = ADVICE_HEAD_BYTES, ADVICE_LENGTH
    elif kind & MARK:
        return kind, at + MARK_BYTES, at + MARK_BYTES
    payload_at = at + head
    last = payload_at + get_u16(raw, at + length_at) if payload_at <= end else payload_at
    return (kind if last <= end else CUT), payload_at, last


@kernel
def write(f: Fleet, i: int, at: int, source: Row, length: int) -> None:
    """Write `source[:length]` to robot i's log from `at` on."""
    front = f.log.shape[1]
    here = min(max(front - at, 0), length)
    copy(f.log[i], at, source, 0, here)
    if here < length:
        copy(f.log_rest[i], at + here - front, source, here, length - here)


@kernel
def read(f: Fleet, i: int, length: int, to: Row, to_at: int) -> None:
    """Copy the first `length` bytes of robot i's log to `to`, from `to_at` on."""
    front = min(f.log.shape[1], length)
    copy(to, to_at, f.log[i], 0, front)
    if front < length:
        copy(to, to_at + front, f.log_rest[i], 0, length - front)


def logged(f: Fleet, i: int, begin: int = 0, end: int | None = None) -> bytes:
    """Return robot i's log, or its bytes from offset `begin` to `end`."""
    end, front = int(f.robot[i].log_len) if end is None else end, f.log.shape[1]
    return bytes(f.log[i, begin:end]) + bytes(f.log_rest[i, max(begin - front, 0) : max(end - front, 0)])


@kernel
def append(f: Fleet, i: int, entry: Row, length: int) -> int:
    """Append an entry; return -1 if the log is full: the robot then fails its audits. Source: RoboRebound §3.4."""
    r = f.robot[i]
    at = r.log_len
    if at + length > f.settings[0].log_max:
        r.log_full = 1
        return -1
    write(f, i, at, entry, length)
    r.log_len = at + length
    r.log_max = max(r.log_max, r.log_len)
    return 0


@kernel
def mark(f: Fleet, i: int, kind: int) -> int:
    """Append a mark; return 0, or -1 if the log is full. Source: docs/spec/rebound.md."""
    r = f.robot[i]
    if r.log_len + 1 > f.settings[0].log_max:
        r.log_full = 1
        return -1
    front = f.log.shape[1]
    if r.log_len < front:
        f.log[i, r.log_len] = kind
    else:
        f.log_rest[i, r.log_len - front] = kind
    r.log_len += 1
    return 0


@kernel
def truncate(f: Fleet, i: int) -> None:
    """Remove the log up to and including the pending checkpoint's mark. Source: RoboRebound §3.6."""
    r = f.robot[i]
    begin, front, at = r.checkpoint_at + 1, f.log.shape[1], 0
    r.log_len -= begin
    r.checkpoint_at = -1
    while at < r.log_len:
        source, length = begin + at, r.log_len - at
        length = min(length, front - source) if source < front else length
        length = min(length, front - at) if at < front else length
        if source < front:
            copy(f.log[i], at, f.log[i], source, length)
        elif at < front:
            copy(f.log[i], at, f.log_rest[i], source - front, length)
        else:
            copy(f.log_rest[i], at - front, f.log_rest[i], source - front, length)
        at += length
