"""Driver that uses a DotBot behind PyDotBot's controller as a robot's sensors and motors (`controller: wheels`).

PyDotBot's controller accepts commands from any client. A compromised daemon can therefore drive the robot past its
trusted nodes.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Mapping

from phalanx.daemon.driver import Driver, NoReading
from phalanx.errors import Unknown, UsageError
from phalanx.robot import Led, Robot

from .line import parse_dotbot_url
from .stream import ADDRESS
from .swarm import DotbotSwarm

HINT = "dotbot://HOST:PORT/ADDRESS, 16 digits: dotbot://127.0.0.1:8000/DECAFBAD00000001"
WAIT_S = 20.0
OLD_S = 1.0  # older positions are no readings


class DotbotDriver(Driver):
    """Driver of one DotBot, until it is closed. Raises: UsageError: no such URL or robot; Unavailable."""

    def __init__(self, rob_id: int, where: str) -> None:
        super().__init__(rob_id)
        url, _, self._address = where.rpartition("/")
        if not ADDRESS.fullmatch(self._address):
            raise UsageError(f"driver is {where!r}", HINT)
        self._led: Led | None = None
        self._swarm = DotbotSwarm(parse_dotbot_url(url), WAIT_S)
        self._swarm.__enter__()
        if self._told() is None:
            self.close()
            raise UsageError(f"no DotBot {self._address} at {url}", "use the address that the controller's page shows")
        logging.getLogger(__name__).warning(
            "robot %d: any client of the DotBot controller can drive it past its trusted nodes", rob_id
        )

    def sense(self) -> Mapping[str, float]:
        """Return the robot's position and direction from the controller. Raises: NoReading: unknown, or too old."""
        told = self._told()
        if told is None:
            raise NoReading("the DotBot controller does not list this robot")
        if math.isnan(told.at.x_mm):
            raise NoReading("the DotBot controller has no position for this robot")
        if time.time() - told.heard_at_s > OLD_S:
            raise NoReading(f"the DotBot controller has not heard from this robot for {OLD_S:g} s")
        return {"x_mm": told.at.x_mm, "y_mm": told.at.y_mm, "direction_deg": told.direction_deg}

    def drive(self, command: Mapping[str, float]) -> None:
        """Send the wheel speeds each time, as a DotBot stops after 0.5 s without them; send a changed LED colour."""
        led = Led(*(int(command[name]) for name in ("red", "green", "blue")))
        with contextlib.suppress(Unknown):  # the controller is unreachable: the robot stops by itself
            self._swarm.drive(self._address, int(command["left"]), int(command["right"]))
            if led != self._led:
                self._swarm.set_led(self._address, led)
                self._led = led

    def stop(self) -> None:
        """See `Driver`."""
        with contextlib.suppress(Unknown):
            self._swarm.stop(self._address)

    def close(self) -> None:
        """Stop the robot and disconnect from the controller."""
        self._swarm.__exit__(None, None, None)

    def _told(self) -> Robot | None:
        return next((each for each in self._swarm.robots() if each.address == self._address), None)
