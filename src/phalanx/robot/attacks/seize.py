"""Orders in the name of those whom robots obey."""

from __future__ import annotations

from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.robot.actions import EVERYBODY, Action
from phalanx.wire import driven
from phalanx.wire.driven import GATEWAY, ORDER, SIGNATURE_BYTES, SIGNER_KEY_BYTES, TELL_STOP, TELL_WHEELS

from .liar import Liar

MOST = 2**63 - 1  # the highest number that a robot takes


class SeizeOrders(Liar):
    """Has all robots stand, in the gateway's name: by the highest number, by a stop, and by what was said before.

    Whoever believes the first of these obeys no true order any more.

    Attributes:
        key: what it signs with; its own, unless somebody has given it the gateway's.
    """

    period_ms = 100
    _heard: bytes = b""
    _heard_ms = 0
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.key = Ed25519PrivateKey.from_private_bytes(self.plan.chance.bytes(SIGNER_KEY_BYTES))

    def on_packet(self, now_ms: int, frame: bytes) -> list[Action]:
        """The gateway's last order is remembered: whose mission it is, and what its clock says."""
        is_order = frame[0] == driven.KIND_ORDER and len(frame) >= ORDER.size + SIGNATURE_BYTES
        if is_order and ORDER.decode(frame)["signer"] == GATEWAY:
            self._heard, self._heard_ms = frame, now_ms
        return super().on_packet(now_ms, frame)

    def on_wake(self, now_ms: int) -> list[Action]:
        """One of the three, when the bucket is full enough for it."""
        told = ORDER.decode(self._heard) if self._heard else {"mission": 1, "said": self._heard_ms}
        fields = {
            "mission": told["mission"],
            "signer": GATEWAY,
            "said": told["said"] + now_ms - self._heard_ms,
            "id": 0,
        }
        forged = (
            ORDER.encode(**fields, number=MOST, action=TELL_WHEELS, body=driven.ORDER_WHEELS.encode(left=0, right=0)),
            ORDER.encode(**fields, number=0, action=TELL_STOP, body=b""),
        )
        frames = [raw + self.key.sign(raw) for raw in forged] + [self._heard] * bool(self._heard)
        actions = self.send(now_ms, frames[self._turn % len(frames)], EVERYBODY)
        self._turn += bool(actions)
        return actions
