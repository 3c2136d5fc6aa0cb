"""Envelopes (a timestamp and a payload, sealed), and the pin message, the only message without an envelope.

Source: docs/spec/link.md.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, NoReturn

from phalanx.crypto import open_jwe, seal_jwe
from phalanx.errors import BadPayload, MalformedEnvelope, OpenError, PeerError, UsageError

from .pin import BadPin, Epoch, Pin
from .replay import ReplayCache

PIN_MESSAGE_CMD = 255


@dataclass(frozen=True, slots=True)
class Envelope:
    """Content of an authentic, fresh message that is no replay."""

    timestamp_s: float
    payload: Any


def encode_json(value: Any) -> bytes:
    """Encode `value` as compact JSON. Raises: ValueError, TypeError: it is not JSON (NaN included)."""
    return _ENCODER.encode(value).encode()


def decode_json(raw: bytes) -> Any:
    """Decode a peer's JSON. Raises: BadPayload: not JSON, NaN, infinite, a duplicate key, or nested too deep."""
    try:
        return _DECODER.decode(raw.decode("utf-8"))
    except (ValueError, RecursionError, MalformedEnvelope) as error:  # ValueError: also an integer of too many digits
        raise BadPayload("not JSON") from error


def encode_envelope(payload: Any, now_s: float) -> bytes:
    """Return the plaintext of an envelope. Raises: ValueError, TypeError: the payload is not JSON (NaN included)."""
    return encode_json({"timestamp": now_s, "payload": payload})


def encode_to_send(payload: Any, now_s: float, max_bytes: int, readers: str) -> bytes:
    """Return an envelope's plaintext. Raises: UsageError: not JSON, or longer than the `max_bytes` of `readers`."""
    try:
        plaintext = encode_envelope(payload, now_s)
    except (TypeError, ValueError, RecursionError) as error:
        raise UsageError(f"payload is not JSON: {error}") from error
    if len(plaintext) > max_bytes:
        raise UsageError(f"message of {len(plaintext)} bytes, {readers} accept {max_bytes}", "send less at once")
    return plaintext


def encode_pin_message(pin: Pin) -> bytes:
    """Return the plaintext of a pin message: no envelope, the pin a string. Source: Qrkey §III-D."""
    return encode_json({"cmd": PIN_MESSAGE_CMD, "pin_code": pin.digits})


def seal(plaintext: bytes, epoch: Epoch, iv: bytes) -> bytes:
    """Encrypt `plaintext` with the key of `epoch`; `iv` is 12 fresh random bytes."""
    return seal_jwe(plaintext, epoch.key, iv)


def open_envelope(
    token: bytes, epoch: Epoch, now_s: float, cache: ReplayCache, max_bytes: int, *, pin_message_may_come: bool = False
) -> Envelope | Pin:
    """Open an untrusted JWE: return its envelope, or the new pin of a pin message if one may come.

    The message enters the cache once it is authentic and fresh. `now_s` is the receiver's clock, seconds since 1970.

    Raises: OpenError: for every failure alike; the actual error is its `cause`.
    """
    try:
        iv, plaintext = open_jwe(token, epoch.key, max_bytes)
        fields = _parse_object(plaintext)
        if pin_message_may_come and "timestamp" not in fields and fields.get("cmd") == PIN_MESSAGE_CMD:
            return _announced_pin(fields)
        timestamp_s = _timestamp(fields)
        if "payload" not in fields:
            raise MalformedEnvelope("no payload")
        cache.enter(epoch.topic, iv, timestamp_s, now_s)
        return Envelope(timestamp_s, fields["payload"])
    except PeerError as error:
        raise OpenError(error) from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    # Parsers differ in which of two values of one key they take: one could check a value and another use the other.
    if len(fields) != len(pairs):
        raise MalformedEnvelope("duplicate key")
    return fields


def _refuse_constant(name: str) -> NoReturn:
    raise MalformedEnvelope(f"{name} is not JSON")


def _finite(text: str) -> float:
    # Python parses 1e999 as infinity, which JSON cannot represent.
    value = float(text)
    if not math.isfinite(value):
        raise MalformedEnvelope(f"{text[:20]} is not finite")
    return value


# json.dumps and json.loads with options make a new coder at each call, which costs more than the cipher.
_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)
_DECODER = json.JSONDecoder(parse_constant=_refuse_constant, parse_float=_finite, object_pairs_hook=_once)


def _parse_object(plaintext: bytes) -> dict[str, Any]:
    try:
        fields = _DECODER.decode(plaintext.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # ValueError: not UTF-8, not JSON, or an integer of too many digits
        raise MalformedEnvelope("not JSON") from error
    if not isinstance(fields, dict):
        raise MalformedEnvelope("not a JSON object")
    return fields


def _timestamp(fields: dict[str, Any]) -> float:
    value = fields.get("timestamp")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedEnvelope("timestamp missing, or not a number")
    try:
        return float(value)
    except OverflowError as error:
        raise MalformedEnvelope("timestamp is not finite") from error


def _announced_pin(fields: dict[str, Any]) -> Pin:
    try:
        return Pin(fields.get("pin_code"))  # type: ignore[arg-type]  # Pin checks it
    except BadPin as error:
        raise MalformedEnvelope("pin message without a pin") from error
