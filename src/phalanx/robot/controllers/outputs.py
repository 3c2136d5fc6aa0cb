"""What a controller puts out on one INPUT: records `output` of phalanx.wire.table, the command first."""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire.fields import Row, put_u16, put_u64
from phalanx.wire.table import OUTPUT, STATE

HEAD_BYTES = OUTPUT.size
LENGTH = OUTPUT.at("payload")
OUT_BYTES = 64  # more than any bundled controller puts out at once
ID, TIME = map(STATE.at, ("id", "t"))  # as in every message of a controller's


@kernel
def put_head(out: Row, at: int, entry: int, length: int, kind: int, rob_id: int, t_ms: int) -> int:
    """The head of an output is at `at`, its message's kind, id and time behind it; where the message begins."""
    out[at] = entry
    put_u16(out, at + LENGTH, length)
    begin = at + HEAD_BYTES
    out[begin] = kind
    put_u16(out, begin + ID, rob_id)
    put_u64(out, begin + TIME, t_ms)
    return begin
