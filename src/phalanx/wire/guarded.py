"""Records of guarded robots: planners' advice, its log entry, and the guard's memory. Part of the byte table.

Neighbours are records `neighbour` of table.py.
"""

from __future__ import annotations

from .driven import SIGNATURE_BYTES
from .record import record

MARK_ADVICE = 0x85
KIND_WISH = 0x0C
KIND_SIGNED_WISH = 0x0F
ENVELOPE_BYTES = 20
IS_FRESH = 1

ADVICE = record(
    "advice: advice of a planner, in no chain: it is an untrusted input",
    "bytes v16: u16 length, then the advice",
    tag=MARK_ADVICE,
)
WISH = record(
    "wish: advice: the velocity that a planner asks for", "vx_mps vy_mps f32: velocity, world frame", tag=KIND_WISH
)
SIGNED_WISH = record(
    "signed_wish: signed advice: a velocity, then the planner's Ed25519 signature over all bytes before it, 64 bytes",
    "mission u32: sequence number of the mission key",
    "id u16: id of the robot that receives the advice",
    "t u64: ms, clock of that robot in the reading that the planner answers",
    "vx_mps vy_mps f32: velocity, world frame",
    tag=KIND_SIGNED_WISH,
)
SIGNED_BYTES = SIGNED_WISH.size + SIGNATURE_BYTES
PROMISES = 4  # records `promise` in a robot's memory
PROMISE = record(
    "promise: a broadcast velocity that a guarded robot keeps until a given time",
    "until u64: ms, s-node's clock; 0: none",
    "vx_mps vy_mps f32: velocity that it broadcast, world frame",
)
GUARD_MEMORY = record(
    "guard_memory: memory of a guard",
    "envelope b20: SHA-1 of the mission's envelope",
    "ax_mps2 ay_mps2 f32: the last command",
    "vx_mps vy_mps f32: the last wish, limited to the envelope's speed",
    "fresh u8: 1: a wish arrived after the last INPUT (signed: one was checked since)",
    "wished u64: ms, s-node's clock at the first INPUT after the wish, or its signed `t`; 0: none yet",
    "stands u64: ms, time until which it stands still, whatever the wish",
    f"promises b{PROMISES * PROMISE.size}: four records `promise`",
    "count u16: number of neighbours",
    "neighbours rest: `count` records, by rising id",
)
