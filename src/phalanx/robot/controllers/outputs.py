"""What a controller puts out on one INPUT: records `output` of phalanx.wire.table, the command first."""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire.fields import put_u16
from phalanx.wire.table import OUTPUT

from .fields import Row

HEAD_BYTES = OUTPUT.size
LENGTH = OUTPUT.at("payload")
OUT_BYTES = 64  # more than any bundled controller puts out at once


@kernel
def put_head(out: Row, at: int, kind: int, length: int) -> int:
    """The head of an output is at `at`; where its payload begins."""
    out[at] = kind
    put_u16(out, at + LENGTH, length)
    return at + HEAD_BYTES
