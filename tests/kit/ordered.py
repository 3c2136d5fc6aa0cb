"""Orders as tests need them: signed with keys that anybody can make, each field as it is wished."""

from __future__ import annotations

import struct

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.config.flock import WheelsConfig
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.bundled.wheels import wheels_params
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.python_controller import Act
from phalanx.robot.signer import Signer
from phalanx.wire import driven
from phalanx.wire.driven import GATEWAY, OPERATOR

KEYS = {who: Ed25519PrivateKey.from_private_bytes(bytes([who + 1]) * 32) for who in (GATEWAY, OPERATOR)}
PUBLIC = {who: key.public_key().public_bytes_raw() for who, key in KEYS.items()}
MISSION = 7
# Between two orders, if a test does not say: nothing is late then.
LONG_MS = 1_000_000


def robot(rob: int = 1, **config):
    """A driven robot of the mission."""
    keys = {"gateway_key": PUBLIC[GATEWAY], "operator_key": PUBLIC[OPERATOR]}
    told = WheelsConfig(**{"mission": MISSION, **keys, **config})
    return compiled(dispatch.NUMBERS["wheels"], wheels_params(told))(rob)


def signer(who: int = GATEWAY, mission: int = MISSION) -> Signer:
    return Signer(KEYS[who], mission, who)


def signed(raw: bytes, who: int = GATEWAY) -> bytes:
    return raw + KEYS[who].sign(raw)


def order(rob: int, number: int, action: int, body: bytes = b"", *, who=GATEWAY, key=None, mission=MISSION, said=None):
    said = LONG_MS * number if said is None else said
    fields = {"mission": mission, "signer": who, "number": number, "said": said}
    return signed(driven.ORDER.encode(**fields, id=rob, action=action, body=body), who if key is None else key)


def wheels_order(rob: int, number: int, left: int, right: int, **more) -> bytes:
    return order(rob, number, driven.TELL_WHEELS, driven.ORDER_WHEELS.encode(left=left, right=right), **more)


def led_order(rob: int, number: int, red: int, green: int, blue: int, **more) -> bytes:
    return order(rob, number, driven.TELL_LED, driven.ORDER_LED.encode(red=red, green=green, blue=blue), **more)


def route_order(rob: int, number: int, threshold_mm: int, points, **more) -> bytes:
    ways = b"".join(driven.WAYPOINT.encode(x_mm=x, y_mm=y) for x, y in points)
    body = driven.ORDER_ROUTE.encode(threshold_mm=threshold_mm, count=len(points), points=ways)
    return order(rob, number, driven.TELL_ROUTE, body, **more)


def stop_order(rob: int, said: int, **more) -> bytes:
    return order(rob, 0, driven.TELL_STOP, said=said, **more)


def reading(rob, x, y, direction, t=0):
    return struct.pack("<BHQ3f", 0x06, rob, t, x, y, direction)


def command(outputs):
    """Left, right, and the colour."""
    (payload,) = (output.payload for output in outputs if isinstance(output, Act))
    kind, _, _, left, right, *led = struct.unpack("<BHQ2b3B", payload)
    assert kind == 0x05
    return left, right, tuple(led)


def wheels(this, t, x=500, y=500, direction=0, step=0):
    return command(this.on_input(step, t, reading(this.rob_id, x, y, direction)))[:2]
