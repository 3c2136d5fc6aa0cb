"""The byte table's page of guarded robots: what planners advise, how it is logged, and what the guard remembers.

Its neighbours are the table's own records `neighbour`.
"""

from __future__ import annotations

from .driven import SIGNATURE_BYTES
from .record import Field, Record

MARK_ADVICE = 0x85
KIND_WISH = 0x0C
KIND_SIGNED_WISH = 0x0F
ENVELOPE_BYTES = 20
IS_FRESH = 1

ADVICE = Record(
    "advice",
    (Field("bytes", "v16", "u16 length, then what a planner said"),),
    "what a planner said, in no chain: nobody needs to believe it",
    MARK_ADVICE,
)
WISH = Record(
    "wish",
    (Field("vx_mps", "f32", "velocity, world frame"), Field("vy_mps", "f32", "")),
    "advice: how a planner wants the robot to move",
    KIND_WISH,
)
SIGNED_WISH = Record(
    "signed_wish",
    (
        Field("mission", "u32", "its number, as the mission key has it"),
        Field("id", "u16", "of the robot that is advised"),
        Field("t", "u64", "ms, that robot's clock in the reading that is answered"),
        Field("vx_mps", "f32", "velocity, world frame"),
        Field("vy_mps", "f32", ""),
    ),
    "the same, and then the adviser's Ed25519 signature of all before it, 64 bytes",
    KIND_SIGNED_WISH,
)
SIGNED_BYTES = SIGNED_WISH.size + SIGNATURE_BYTES
PROMISES = 4  # that a robot remembers
PROMISE = Record(
    "promise",
    (
        Field("until", "u64", "ms, s-node's clock; 0: none"),
        Field("vx_mps", "f32", "velocity that was said, world frame"),
        Field("vy_mps", "f32", ""),
    ),
    "what a guarded robot keeps to",
)
GUARD_MEMORY = Record(
    "guard_memory",
    (
        Field("envelope", "b20", "SHA-1 of the mission's envelope"),
        Field("ax_mps2", "f32", "the last command"),
        Field("ay_mps2", "f32", ""),
        Field("vx_mps", "f32", "the last wish, no faster than the envelope"),
        Field("vy_mps", "f32", ""),
        Field("fresh", "u8", "1: the wish came after the last INPUT; of signed ones, one was looked at since"),
        Field(
            "wished", "u64", "ms, s-node's clock at the first INPUT behind the wish, or as it is signed; 0: none yet"
        ),
        Field("stands", "u64", "ms, until when it stands still whatever is wished"),
        Field("promises", f"b{PROMISES * PROMISE.size}", "four records promise"),
        Field("count", "u16", "of neighbours"),
        Field("neighbours", "rest", "as many, by rising id"),
    ),
    "what a guard remembers",
)
