"""The c-node's log: entries exactly as the trusted nodes chained them, in the order of processing, and marks.

A mark is one byte, is in no chain, and tells the auditor where a chain was flushed before its batch was full, and where
the checkpoint was taken. Behind an INPUT there may be evidence: in no chain either, but a chained INPUT has the hash of
what it shows (docs/spec/rebound.md). Advice stands where the controller was given it, and nothing vouches for it.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire import guarded, table
from phalanx.wire.fields import Row, copy

from .fleet import Fleet

MARK = table.MARK
MARK_BYTES = table.CHECKED.size
FLUSH_S, FLUSH_A, CHECKPOINT = table.MARK_FLUSH_S, table.MARK_FLUSH_A, table.MARK_CHECKPOINT
EVIDENCE = table.MARK_EVIDENCE
EVIDENCE_HEAD_BYTES = table.EVIDENCE.size
EVIDENCE_LENGTH = table.EVIDENCE.at("bytes")
ADVICE = guarded.MARK_ADVICE
ADVICE_HEAD_BYTES = guarded.ADVICE.size
ADVICE_LENGTH = guarded.ADVICE.at("bytes")


@kernel
def append(f: Fleet, i: int, entry: Row, length: int) -> int:
    """The entry logged; -1 if the log is full, after which the robot cannot pass an audit. Source: RoboRebound §3.4."""
    r = f.robot[i]
    at = r.log_len
    if at + length > f.log.shape[1]:
        r.log_full = 1
        return -1
    copy(f.log[i], at, entry, 0, length)
    r.log_len = at + length
    r.log_max = max(r.log_max, r.log_len)
    return 0


@kernel
def mark(f: Fleet, i: int, kind: int) -> int:
    """The mark logged; -1 if the log is full. Source: docs/spec/rebound.md."""
    r = f.robot[i]
    if r.log_len + 1 > f.log.shape[1]:
        r.log_full = 1
        return -1
    f.log[i, r.log_len] = kind
    r.log_len += 1
    return 0


@kernel
def truncate(f: Fleet, i: int) -> None:
    """The log begins behind the pending checkpoint's mark. Source: RoboRebound §3.6."""
    r = f.robot[i]
    begin = r.checkpoint_at + 1
    copy(f.log[i], 0, f.log[i], begin, r.log_len - begin)
    r.log_len -= begin
    r.checkpoint_at = -1
