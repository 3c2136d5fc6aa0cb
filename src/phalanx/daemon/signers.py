"""Who signed what a robot's log says that it was told: orders of a gateway or an operator, and advice.

Anybody can check that, with the public keys in the mission's file. Source: docs/spec/orders.md, docs/guard.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from phalanx.bti import log, trusted
from phalanx.wire import guarded
from phalanx.wire.driven import GATEWAY, KIND_ORDER, OPERATOR, ORDER, SIGNATURE_BYTES
from phalanx.wire.fields import row
from phalanx.wire.table import ENTRY_HEADER_BYTES, ENTRY_RECV

from .evidence import Kept

NOBODY, UNKNOWN = "nobody whom the mission names", "somebody: too many to look at"
MOST_LOOKS = 50_000  # a hostile log has 700 000; an hour of a joystick's orders is 20 000
AT_SIGNER = ORDER.at("signer")


@dataclass(slots=True)
class Signed:
    """What one signer said in a log, each thing once; times are seconds since the mission key."""

    signer: str
    key: str  # public, hexadecimal; "" for nobody's
    count: int
    first_s: float
    last_s: float


def signed_in(kept: Kept) -> list[Signed]:
    """Who said what the robot was told, in the order in which they are first heard; NOBODY for what is forged."""
    found: dict[str, Signed] = {}
    seen: set[bytes] = set()
    for t_ms, said, keys in _told(kept):
        if said in seen:  # a stop is said again and again; and what is held back comes twice
            continue
        signer = UNKNOWN
        if len(seen) < MOST_LOOKS:
            seen.add(said)
            signer = next((name for name, key in keys.items() if _is_by(key, said)), NOBODY)
        at_s = (t_ms - kept.t_key_ms) / 1000
        told = found.setdefault(signer, Signed(signer, keys.get(signer, ""), 0, at_s, at_s))
        told.count += 1
        told.last_s = at_s
    return list(found.values())


def _told(kept: Kept) -> Iterator[tuple[int, bytes, dict[str, str]]]:
    """When it was told what, and the public keys of who may have said so."""
    scenario, now_ms = kept.scenario, kept.t_key_ms
    who = {GATEWAY: ("gateway", scenario.gateway_key), OPERATOR: ("operator", scenario.operator_key)}
    for each in kept.entries():
        now_ms = max(now_ms, each.t_ms)
        if each.kind == ENTRY_RECV:
            said = kept.raw[each.at + ENTRY_HEADER_BYTES : each.end]
            if len(said) >= ORDER.size + SIGNATURE_BYTES and said[0] == KIND_ORDER:
                named = who.get(said[AT_SIGNER])
                yield now_ms, said, dict([named] if named else [])
        elif each.kind == log.ADVICE:
            said = kept.raw[each.at + guarded.ADVICE.size : each.end]
            if len(said) == guarded.SIGNED_BYTES and said[0] == guarded.KIND_SIGNED_WISH:
                yield now_ms, said, {"adviser": scenario.guard.adviser_key}


def _is_by(key: str, said: bytes) -> bool:
    return bool(key) and trusted.order_check(row(bytes.fromhex(key)), row(said), len(said)) == 0
