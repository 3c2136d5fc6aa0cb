"""Cache of passed audits for simulations: the audit of a request that extends a passed one resumes where that ended.

A robot sends its log to f_max + 1 auditors per round, each time with a few entries more. In a simulation all auditors
share one process. An audit's verdict depends only on the bytes shown, the mission and the keys, which are equal in all
robots that get this far. So bytes that passed once, compared byte for byte, pass again. The parts that differ from
request to request (time, MACs and the tops of the chains) are checked each time.

Physical robots do not use this cache: their auditors are other machines.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import Records, U8x2, U8x3
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.pool import sparse
from phalanx.wire import table
from phalanx.wire.fields import Row, copy, same
from phalanx.wire.table import HASH_BYTES

from .work import CASE, Work

FLAGS, HCKPT, LENGTH = map(table.REQUEST.at, ("flags", "hckpt", "segment_length"))
HEAD_BYTES, CHECKPOINT_BYTES = table.REQUEST.size, table.CHECKPOINT.size
MOST_SLOTS = 256


class Memo(NamedTuple):
    """The last request of each robot that passed, until another's takes its slot."""

    passed: Annotated[Any, Records(CASE)]  # (S,), the case at the end of its audit; `auditee` 0: empty slot
    shown: U8x2  # (S, R), the request
    tops: U8x3  # (S, 2, 20)
    state: U8x2  # (S, C + 48), a checkpoint: its fixed fields, then the controller's state
    waiting: U8x2  # (S, W), outputs that must still appear in the log


pack = bundled(Memo)


def make_memo(robots: int, request_bytes: int, state_bytes: int, waiting_bytes: int) -> Memo:
    """Return an empty cache."""
    slots = min(robots, MOST_SLOTS)
    made = Memo(
        passed=np.zeros(slots, CASE).view(np.recarray),
        shown=sparse(slots, request_bytes),
        tops=np.zeros((slots, 2, HASH_BYTES), np.uint8),
        state=np.zeros((slots, state_bytes + CHECKPOINT_BYTES), np.uint8),
        waiting=sparse(slots, waiting_bytes),
    )
    return pack(made)


@kernel
def recall(memo: Memo, w: Work, q: Row) -> int:
    """Return how many bytes of the request in `q`, parsed in `w.case`, have passed before.

    If not 0, restore `w` as of the end of that audit: case, both chains, controller's state and expected outputs.
    """
    c = w.case[0]
    slot = c.auditee % len(memo.passed)
    passed, shown = memo.passed[slot], memo.shown[slot]
    n, t, end = passed.end, c.t, c.end
    if passed.auditee != c.auditee or n > end or t < passed.t or q[FLAGS] != shown[FLAGS]:
        return 0
    # Of the header, compare the checkpoint's hash, the number of tokens and the start's length.
    if not same(q, HCKPT, shown, HCKPT, LENGTH - HCKPT) or not same(q, HEAD_BYTES, shown, HEAD_BYTES, n - HEAD_BYTES):
        return 0
    w.case[0] = passed
    c.t = t
    c.at = n
    c.checkpoints = 1
    c.end = end
    for k in range(2):
        copy(w.tops[k], 0, memo.tops[slot, k], 0, HASH_BYTES)
    copy(w.state, 0, memo.state[slot], 0, CHECKPOINT_BYTES + c.state_len)
    copy(w.waiting, 0, memo.waiting[slot], 0, c.waiting)
    return int(n)


@kernel
def remember(memo: Memo, w: Work, q: Row, known: int) -> None:
    """Store that the request in `q` has passed, of which `known` bytes are stored already; `w` is its audit's result.

    Requests that end right after an entry are not stored: later evidence for that entry could change the replay.
    """
    c = w.case[0]
    if c.marked == 0 or c.end > memo.shown.shape[1]:
        return
    slot = c.auditee % len(memo.passed)
    copy(memo.shown[slot], 0, q, 0, HEAD_BYTES)
    begin = max(known, HEAD_BYTES)
    copy(memo.shown[slot], begin, q, begin, c.end - begin)
    memo.passed[slot] = c
    for k in range(2):
        copy(memo.tops[slot, k], 0, w.tops[k], 0, HASH_BYTES)
    copy(memo.state[slot], 0, w.state, 0, CHECKPOINT_BYTES + c.state_len)
    copy(memo.waiting[slot], 0, w.waiting, 0, c.waiting)
