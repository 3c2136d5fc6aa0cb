"""Decode payloads of commands and requests in sessions: strict JSON of limited depth."""

from __future__ import annotations

from typing import Any

from phalanx.errors import BadPayload
from phalanx.link.envelope import decode_json

JSON_DEPTH = 8


def request_words(payload: bytes) -> dict[str, Any]:
    """Return a request's object, {} without a payload. Raises: BadPayload: as `parse_payload`; not an object."""
    return check_words(parse_payload(payload) if payload else {})


def check_words(words: Any) -> dict[str, Any]:
    """Return a request's payload if it is an object. Raises: BadPayload."""
    if not isinstance(words, dict):
        raise BadPayload("a request's payload is an object")
    return words


def parse_payload(payload: bytes) -> Any:
    """Decode a payload's JSON. Raises: BadPayload: not JSON, duplicate keys, not finite, or over eight levels."""
    value = decode_json(payload)
    level = [value]
    for _ in range(JSON_DEPTH):
        level = [
            below
            for each in level
            if isinstance(each, dict | list)
            for below in (each.values() if isinstance(each, dict) else each)
        ]
        if not level:
            return value
    raise BadPayload(f"more than {JSON_DEPTH} levels")
