"""What a controller puts out on one INPUT: `type u8, length u16, payload`, the command first, then what it sends."""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire.fields import put_u16

from .fields import Row

HEAD_BYTES = 3
OUT_BYTES = 64  # more than any bundled controller puts out at once


@kernel
def put_head(out: Row, at: int, kind: int, length: int) -> int:
    """The head of an output is at `at`; where its payload begins."""
    out[at] = kind
    put_u16(out, at + 1, length)
    return at + HEAD_BYTES
