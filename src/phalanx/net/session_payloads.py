"""Validation and encoding of a session client's commands and requests."""

from __future__ import annotations

import re
from typing import Any

from phalanx.errors import UsageError
from phalanx.link.envelope import encode_json

LONGEST = 16_000  # bytes of a payload: a record to the server has at most 16 KiB including names and padding
NAME_BYTES = 255


def payload_bytes(payload: Any) -> bytes:
    """Encode a payload as JSON. Raises: UsageError: it is not JSON (NaN included), or too long."""
    try:
        body = encode_json(payload)
    except (TypeError, ValueError, RecursionError) as error:
        raise UsageError(f"payload is not JSON: {error}") from error
    if len(body) > LONGEST:
        raise UsageError(f"payload of {len(body)} bytes, limit {LONGEST}", "send less at once")
    return body


def wheels(left_pct: float, right_pct: float) -> dict[str, float]:
    """Return the payload of `move_raw`."""
    return {"left_x": 0, "left_y": left_pct, "right_x": 0, "right_y": right_pct}


def check_word(grammar: re.Pattern[str], word: str, what: str) -> None:
    """Raise UsageError if `word` does not match `grammar`; `what` names it in the message."""
    if not grammar.fullmatch(word):
        raise UsageError(f"not {what}: {word[:80]!r}", "use at most 64 letters, digits, - and _")


def check_nickname(name: str) -> None:
    """Raise UsageError if a nickname does not fit into the first message. The server may shorten it."""
    if not 0 <= len(name.encode(errors="replace")) <= NAME_BYTES or not name.isprintable():
        raise UsageError("not a valid nickname", f"use one line of at most {NAME_BYTES} bytes")
