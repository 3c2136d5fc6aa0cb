"""Your own robots behind the whole gateway: page, map, joystick, QR code. python examples/own_swarm.py"""

import asyncio
import contextlib
import json
import time
from collections.abc import Sequence

from phalanx.errors import Unknown
from phalanx.gateway import UpOptions, up
from phalanx.robot import Led, Point, Robot


class Carts:
    """Two simulated carts that move sideways only. Replace this by your motors and positions."""

    area_mm = (1000, 1000)

    def __init__(self) -> None:
        self.x_mm = {"CART-A": 200.0, "CART-B": 800.0}
        self.led = dict.fromkeys(self.x_mm, Led(250, 210, 60))

    def robots(self) -> Sequence[Robot]:
        """Return both carts at their current positions."""
        return [
            Robot(
                address=address,
                name=address.title(),
                at=Point(x_mm, 500.0),
                direction_deg=270,
                battery_v=3.0,
                led=self.led[address],
                route=(),
                threshold_mm=60,
                heard_at_s=time.time(),
                history=(),
            )
            for address, x_mm in self.x_mm.items()
        ]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Move a step sideways for every command."""
        if address not in self.x_mm:
            raise Unknown(f"no cart {address}")
        self.x_mm[address] = min(1000.0, max(0.0, self.x_mm[address] + (left_pct + right_pct) / 20))

    def stop(self, address: str) -> None:
        """Do nothing: a cart stands without commands. Yours would stop its motors here, from any thread."""

    def hold(self) -> None:
        """Do nothing, as in `stop`; yours would stop all robots."""

    def release(self) -> None:
        """Allow commands again."""

    def set_led(self, address: str, led: Led) -> None:
        """Store the colour."""
        self.led[address] = led

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Ignore the route: carts follow none."""

    def clear_history(self, address: str) -> None:
        """Do nothing: carts have no trail."""


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(up(UpOptions(port=0), lambda event: print(json.dumps(event), flush=True), swarm=Carts))
