"""The byte table's page of guarded robots: what planners advise, how it is logged, and what the guard remembers.

Its neighbours are the table's own records `neighbour`.
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
    "advice: what a planner said, in no chain: nobody needs to believe it",
    "bytes v16: u16 length, then what a planner said",
    tag=MARK_ADVICE,
)
WISH = record(
    "wish: advice: how a planner wants the robot to move", "vx_mps vy_mps f32: velocity, world frame", tag=KIND_WISH
)
SIGNED_WISH = record(
    "signed_wish: the same, and then the adviser's Ed25519 signature of all before it, 64 bytes",
    "mission u32: its number, as the mission key has it",
    "id u16: of the robot that is advised",
    "t u64: ms, that robot's clock in the reading that is answered",
    "vx_mps vy_mps f32: velocity, world frame",
    tag=KIND_SIGNED_WISH,
)
SIGNED_BYTES = SIGNED_WISH.size + SIGNATURE_BYTES
PROMISES = 4  # that a robot remembers
PROMISE = record(
    "promise: what a guarded robot keeps to",
    "until u64: ms, s-node's clock; 0: none",
    "vx_mps vy_mps f32: velocity that was said, world frame",
)
GUARD_MEMORY = record(
    "guard_memory: what a guard remembers",
    "envelope b20: SHA-1 of the mission's envelope",
    "ax_mps2 ay_mps2 f32: the last command",
    "vx_mps vy_mps f32: the last wish, no faster than the envelope",
    "fresh u8: 1: the wish came after the last INPUT; of signed ones, one was looked at since",
    "wished u64: ms, s-node's clock at the first INPUT behind the wish, or as it is signed; 0: none yet",
    "stands u64: ms, until when it stands still whatever is wished",
    f"promises b{PROMISES * PROMISE.size}: four records promise",
    "count u16: of neighbours",
    "neighbours rest: as many, by rising id",
)
