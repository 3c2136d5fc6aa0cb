"""Signers of orders (by a gateway or an operator) and of advice.

Robots verify signatures in controllers/orders.py and controllers/bundled/guard.py.
"""

from __future__ import annotations

from collections.abc import Sequence

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.errors import UsageError
from phalanx.robot.controllers.orders import THRESHOLD_MAX_MM, WAYPOINTS_MAX
from phalanx.wire import guarded
from phalanx.wire.driven import (
    EVERYBODY,
    ORDER,
    ORDER_LED,
    ORDER_ROUTE,
    ORDER_WHEELS,
    TELL_GO,
    TELL_LED,
    TELL_NOTHING,
    TELL_ROUTE,
    TELL_STOP,
    TELL_WHEELS,
    WAYPOINT,
)


class Signer:
    """Signer of orders for one mission, numbered in rising order. `order_ms` is the time of an order by its own clock.

    Args:
        key: private key, whose public part is in the mission.
        who: GATEWAY or OPERATOR of phalanx.wire.driven.

    Attributes:
        number: number of the last order; stops have none.

    Raises: UsageError: by all methods, if a value is out of range.
    Source: docs/spec/orders.md.
    """

    def __init__(self, key: Ed25519PrivateKey, mission: int, who: int) -> None:
        self._key, self._mission, self._who = key, mission, who
        self.number = 0
        self._order_ms = -1

    @property
    def public(self) -> bytes:
        """Return the public key, 32 bytes."""
        return self._key.public_key().public_bytes_raw()

    def wheels(self, robot: int, order_ms: int, left_pct: int, right_pct: int) -> bytes:
        """Order to turn the wheels for a moment, -100..100, and to end a route. Source: docs/spec/vocabulary.md."""
        return self._order(robot, order_ms, TELL_WHEELS, ORDER_WHEELS.encode(left=left_pct, right=right_pct))

    def led(self, robot: int, order_ms: int, red: int, green: int, blue: int) -> bytes:
        """Order to set the LED's colour, 0..255 each. Source: docs/spec/vocabulary.md."""
        return self._order(robot, order_ms, TELL_LED, ORDER_LED.encode(red=red, green=green, blue=blue))

    def route(self, robot: int, order_ms: int, threshold_mm: int, points_mm: Sequence[tuple[int, int]]) -> bytes:
        """Order to visit at most 32 points, each reached within 1..1000 mm. Source: docs/spec/vocabulary.md."""
        if len(points_mm) > WAYPOINTS_MAX or not 1 <= threshold_mm <= THRESHOLD_MAX_MM:
            raise UsageError(
                f"route of {len(points_mm)} points with a threshold of {threshold_mm} mm",
                f"use at most {WAYPOINTS_MAX} points, and a threshold of 1 to {THRESHOLD_MAX_MM} mm",
            )
        points = b"".join(WAYPOINT.encode(x_mm=x_mm, y_mm=y_mm) for x_mm, y_mm in points_mm)
        body = ORDER_ROUTE.encode(threshold_mm=threshold_mm, count=len(points_mm), points=points)
        return self._order(robot, order_ms, TELL_ROUTE, body)

    def beacon(self, order_ms: int) -> bytes:
        """Make a beacon, sent each second: an empty order by whose time all robots learn which orders are late."""
        return self._order(EVERYBODY, order_ms, TELL_NOTHING)

    def stop(self, order_ms: int) -> bytes:
        """Order all robots to stand still and to ignore orders to move until `go`: an emergency stop."""
        return self._order(EVERYBODY, order_ms, TELL_STOP)

    def go(self, order_ms: int) -> bytes:
        """Allow all robots to obey orders to move again."""
        return self._order(EVERYBODY, order_ms, TELL_GO)

    def _order(self, robot: int, order_ms: int, action: int, body: bytes = b"") -> bytes:
        # Later than the last order, whatever the clock: robots obey a stop only if it is the newest of its signer.
        self._order_ms = max(order_ms, self._order_ms + 1)
        self.number += action != TELL_STOP
        signed = ORDER.encode(
            mission=self._mission,
            signer=self._who,
            number=0 if action == TELL_STOP else self.number,
            said=self._order_ms,
            id=robot,
            action=action,
            body=body,
        )
        return signed + self._key.sign(signed)


class AdviceSigner:
    """Signer of a planner's advice for one mission; the public part of its key is the guard's `adviser_key`."""

    def __init__(self, key: Ed25519PrivateKey, mission: int) -> None:
        self._key, self._mission = key, mission

    @property
    def public(self) -> bytes:
        """Return the public key, 32 bytes."""
        return self._key.public_key().public_bytes_raw()

    def sign(self, robot: int, t_ms: int, wish: bytes) -> bytes:
        """Return the `signed_wish` of a `wish` on the robot's reading of `t_ms`. Source: docs/guides/guard.md."""
        _, vx_mps, vy_mps = guarded.WISH.form.unpack(wish)
        form = guarded.SIGNED_WISH.form
        signed = form.pack(guarded.KIND_SIGNED_WISH, self._mission, robot, t_ms, vx_mps, vy_mps)
        return signed + self._key.sign(signed)
