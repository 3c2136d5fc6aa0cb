"""Sign orders of a gateway or an operator, and advice.

Robots check them in controllers/orders.py and controllers/bundled/guard.py.
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
    """Signs orders of one mission, each with a number above the last; `said_ms` is its own clock.

    Args:
        key: its public part is what the mission names.
        who: GATEWAY or OPERATOR of phalanx.wire.driven.

    Attributes:
        number: of the last order; stops have none.

    Raises: UsageError: from all of its methods, if a value is out of range.
    Source: docs/spec/orders.md.
    """

    def __init__(self, key: Ed25519PrivateKey, mission: int, who: int) -> None:
        self._key, self._mission, self._who = key, mission, who
        self.number = 0
        self._said_ms = -1

    @property
    def public(self) -> bytes:
        """The public key, 32 bytes."""
        return self._key.public_key().public_bytes_raw()

    def wheels(self, robot: int, said_ms: int, left_pct: int, right_pct: int) -> bytes:
        """Turn the wheels for a moment, -100..100; ends waypoint following. Source: docs/spec/vocabulary.md."""
        return self._order(robot, said_ms, TELL_WHEELS, ORDER_WHEELS.encode(left=left_pct, right=right_pct))

    def led(self, robot: int, said_ms: int, red: int, green: int, blue: int) -> bytes:
        """Show a colour, 0..255 each. Source: docs/spec/vocabulary.md."""
        return self._order(robot, said_ms, TELL_LED, ORDER_LED.encode(red=red, green=green, blue=blue))

    def route(self, robot: int, said_ms: int, threshold_mm: int, points_mm: Sequence[tuple[int, int]]) -> bytes:
        """Visit at most 32 points in order, each reached within 1..1000 mm. Source: docs/spec/vocabulary.md."""
        if len(points_mm) > WAYPOINTS_MAX or not 1 <= threshold_mm <= THRESHOLD_MAX_MM:
            raise UsageError(
                f"a route of {len(points_mm)} points within {threshold_mm} mm",
                f"at most {WAYPOINTS_MAX} points, 1 to {THRESHOLD_MAX_MM} mm",
            )
        points = b"".join(WAYPOINT.encode(x_mm=x_mm, y_mm=y_mm) for x_mm, y_mm in points_mm)
        body = ORDER_ROUTE.encode(threshold_mm=threshold_mm, count=len(points_mm), points=points)
        return self._order(robot, said_ms, TELL_ROUTE, body)

    def beacon(self, said_ms: int) -> bytes:
        """Order nothing of everybody, each second: by its time robots learn what is late."""
        return self._order(EVERYBODY, said_ms, TELL_NOTHING)

    def stop(self, said_ms: int) -> bytes:
        """Stand still, and obey no motion until `go`: everybody's emergency stop."""
        return self._order(EVERYBODY, said_ms, TELL_STOP)

    def go(self, said_ms: int) -> bytes:
        """Allow orders to move again."""
        return self._order(EVERYBODY, said_ms, TELL_GO)

    def _order(self, robot: int, said_ms: int, action: int, body: bytes = b"") -> bytes:
        # Later than the last whatever the clock: a stop is obeyed if its signer has said nothing since.
        self._said_ms = max(said_ms, self._said_ms + 1)
        self.number += action != TELL_STOP
        signed = ORDER.encode(
            mission=self._mission,
            signer=self._who,
            number=0 if action == TELL_STOP else self.number,
            said=self._said_ms,
            id=robot,
            action=action,
            body=body,
        )
        return signed + self._key.sign(signed)


class AdviceSigner:
    """Signs what a planner wishes, for one mission; its key's public part is the guard's `adviser_key`."""

    def __init__(self, key: Ed25519PrivateKey, mission: int) -> None:
        self._key, self._mission = key, mission

    @property
    def public(self) -> bytes:
        """The public key, 32 bytes."""
        return self._key.public_key().public_bytes_raw()

    def sign(self, robot: int, t_ms: int, wish: bytes) -> bytes:
        """A `signed_wish` of a `wish`, in answer to the robot's reading of `t_ms`. Source: docs/guides/guard.md."""
        _, vx_mps, vy_mps = guarded.WISH.form.unpack(wish)
        form = guarded.SIGNED_WISH.form
        signed = form.pack(guarded.KIND_SIGNED_WISH, self._mission, robot, t_ms, vx_mps, vy_mps)
        return signed + self._key.sign(signed)
