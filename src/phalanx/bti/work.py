"""Declare the scratch memory of an auditor, and the state of its audit; `audit` has the audit itself."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import I64x1, I64x2, Records, U8x1, U8x2, layout
from phalanx.bundle import bundled
from phalanx.config import BtiConfig
from phalanx.wire import table
from phalanx.wire.table import HASH_BYTES

CASE = layout(
    "auditee i8",
    "t i8",  # of the token request
    "tokens start_at start_len i8",
    "at i8",  # where in the request the replay stands
    "end step i8",
    "due i8",  # of the next INPUT, ms of the auditee's clock; at first what the start says
    "entry_t payload_at payload_len i8",
    "evidence_len i8",  # of the INPUT's, in `work.evidence`
    "waiting i8",  # bytes of expected outputs in `work.waiting`
    "newest i8",  # time of the newest entry
    "checkpoints i8",  # marks of one so far
    "marked i8",  # the last that replay saw was a mark
    "state_len i8",  # of the controller's state
    "known i8",  # bytes of the request that an earlier audit has found right (memo.py)
)

# One action of a robot's event handlers (phalanx.robot.actions): its fields depend on its kind.
ACTION = layout("kind number more begin length i8")
# Beside the outputs of one control step: a verdict, a HELLO, a fragment or a token, and when to go on.
MORE_ACTIONS = 8


class Work(NamedTuple):
    """Scratch memory of one auditor at a time."""

    case: Annotated[Any, Records(CASE)]  # (1,), how far the audit is
    batch: U8x2  # (2, ...): entries of the s- and of the a-chain that are not hashed yet
    held: I64x2  # (2, 2): of each, how many entries, and bytes
    tops: U8x2  # (2, 20): s- and a-chain while they are re-hashed
    state: U8x1  # the replayed controller's state, behind the rest of a checkpoint
    out: U8x1  # outputs of one step of the controller
    waiting: U8x1  # outputs that the log still has to show, as entries of their cause's time
    evidence: U8x1  # what the log keeps beside the INPUT; as long as the longest that is read
    small: U8x2  # (4, 32): token requests, authenticators, hashes
    packet: U8x1  # a radio packet
    entry: U8x1  # a chained entry
    place: I64x1  # (1,): of the request that became whole last
    actions: Annotated[Any, Records(ACTION)]  # of the event that was handled last
    sent: U8x1  # packets and commands of these actions
    used: I64x1  # (2,): how many actions, and bytes of `sent`


pack = bundled(Work)


def make_work(config: BtiConfig) -> Work:
    """Scratch memory for fleets of this configuration."""
    entry = table.ENTRY_HEADER_BYTES + config.packet_max_bytes
    work = Work(
        case=np.zeros(1, CASE).view(np.recarray),
        batch=np.zeros((2, config.batch_size * entry), np.uint8),
        held=np.zeros((2, 2), np.int64),
        tops=np.zeros((2, HASH_BYTES), np.uint8),
        state=np.zeros(config.checkpoint_capacity_bytes + table.CHECKPOINT.size, np.uint8),
        out=np.zeros(2 * entry, np.uint8),
        waiting=np.zeros(4 * entry, np.uint8),
        evidence=np.zeros(config.evidence_max_bytes, np.uint8),
        small=np.zeros((4, table.TOKEN_REQUEST.size), np.uint8),
        packet=np.zeros(entry, np.uint8),
        entry=np.zeros(entry, np.uint8),
        place=np.zeros(1, np.int64),
        actions=np.zeros(2 * entry // table.OUTPUT.size + MORE_ACTIONS, ACTION).view(np.recarray),
        sent=np.zeros(4 * entry, np.uint8),
        used=np.zeros(2, np.int64),
    )
    return pack(work)
