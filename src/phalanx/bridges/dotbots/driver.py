"""A DotBot behind PyDotBot's controller as one robot's sensors and motors, for missions with `controller: wheels`.

Motors hang on that controller, which obeys whoever reaches it: a daemon that is taken over needs not ask anybody.
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
from .swarm import DotbotSwarm
from .told import ADDRESS

HINT = "dotbot://HOST:PORT/ADDRESS, 16 digits: dotbot://127.0.0.1:8000/DECAFBAD00000001"
WAIT_S = 20.0
OLD_S = 1.0  # of a robot that was silent for longer nothing is known


class DotbotDriver(Driver):
    """One DotBot of a controller, until it is closed. Raises: UsageError: no such URL or robot; Unavailable."""

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
            raise UsageError(f"no DotBot {self._address} at {url}", "its address, as the controller's page has it")
        logging.getLogger(__name__).warning(
            "robot %d: whoever reaches the controller of the DotBots drives it past its trusted nodes", rob_id
        )

    def sense(self) -> Mapping[str, float]:
        """Return where the controller says that it is. Raises: NoReading: it does not know, or it is silent."""
        told = self._told()
        if told is None:
            raise NoReading("the controller of the DotBots does not know it")
        if math.isnan(told.at.x_mm):
            raise NoReading("the controller of the DotBots does not know where it is")
        if time.time() - told.heard_at_s > OLD_S:
            raise NoReading(f"the controller of the DotBots has not heard of it for {OLD_S:g} s")
        return {"x_mm": told.at.x_mm, "y_mm": told.at.y_mm, "direction_deg": told.direction_deg}

    def drive(self, command: Mapping[str, float]) -> None:
        """Wheels, each time again, since a DotBot stops by itself after half a second; its light, when that changes."""
        led = Led(*(int(command[name]) for name in ("red", "green", "blue")))
        with contextlib.suppress(Unknown):  # the controller is away: the robot stands by itself
            self._swarm.drive(self._address, int(command["left"]), int(command["right"]))
            if led != self._led:
                self._swarm.set_led(self._address, led)
                self._led = led

    def stop(self) -> None:
        """See `Driver`."""
        with contextlib.suppress(Unknown):
            self._swarm.stop(self._address)

    def close(self) -> None:
        """It stands, and the controller is left."""
        self._swarm.__exit__(None, None, None)

    def _told(self) -> Robot | None:
        return next((each for each in self._swarm.robots() if each.address == self._address), None)
