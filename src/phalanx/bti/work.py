"""Scratch memory of an auditor, and the state of its audit; `audit` has the audit itself."""

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
    "at i8",  # offset in the request of the next item to replay
    "end step i8",
    "due i8",  # of the next INPUT, ms of the auditee's clock; at first from the start checkpoint
    "entry_t payload_at payload_len i8",
    "evidence_len i8",  # of the INPUT's evidence, in `work.evidence`
    "waiting i8",  # bytes of expected outputs in `work.waiting`
    "newest i8",  # time of the newest entry
    "checkpoints i8",  # checkpoint marks so far
    "marked i8",  # 1 if the last item replayed was a mark
    "state_len i8",  # of the controller's state
    "known i8",  # bytes of the request that an earlier audit has verified (memo.py)
)

# One action of a robot's event handlers (phalanx.robot.actions): its fields depend on its kind.
ACTION = layout("kind number more begin length i8")
# Actions of one event beside the outputs of a control step: verdict, HELLO, fragment or token, and the next wake-up.
MORE_ACTIONS = 8


class Work(NamedTuple):
    """Scratch memory of one auditor at a time."""

    case: Annotated[Any, Records(CASE)]  # (1,), progress of the audit
    batch: U8x2  # (2, ...): entries of the s-chain and the a-chain that are not hashed yet
    held: I64x2  # (2, 2): their number and their bytes, for each chain
    tops: U8x2  # (2, 20): s-chain and a-chain while they are hashed again
    state: U8x1  # a checkpoint: its fixed fields, then the replayed controller's state
    out: U8x1  # outputs of one step of the controller
    waiting: U8x1  # outputs that must still appear in the log, as entries with the time of their cause
    evidence: U8x1  # evidence of the last INPUT; as long as the longest that is accepted
    small: U8x2  # (4, 32): token requests, authenticators, hashes
    packet: U8x1  # a radio packet
    entry: U8x1  # a chained entry
    place: I64x1  # (1,): index in `Fleet.rx_info` of the request that was completed last
    actions: Annotated[Any, Records(ACTION)]  # actions of the last event
    sent: U8x1  # packets and commands of these actions
    used: I64x1  # (2,): number of actions, and of bytes in `sent`


pack = bundled(Work)


def make_work(config: BtiConfig) -> Work:
    """Return scratch memory for fleets of this configuration."""
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
