"""Stop robots from a separate thread, so that a busy event loop cannot delay a stop.

Only this file stops robots whose driver is silent, and all robots on the operator's stop. Nothing received over the
link is handled in this thread.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Self

from phalanx.errors import Held, Unknown
from phalanx.robot import Swarm

log = logging.getLogger(__name__)

AGAIN_S = 0.1
EXPIRES_S = 0.3  # a joystick has to repeat its command within this time


class Joysticks:
    """Robots being driven, with expiry times: a robot must not keep moving when its driver's phone fails."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}  # all drive for the same time, so the first entry expires first

    def drive(self, address: str, moving: bool, uptime_s: float) -> None:
        """Note a wheel command."""
        self._until.pop(address, None)
        if moving:
            self._until[address] = uptime_s + EXPIRES_S

    def is_driven(self, address: str) -> bool:
        """Return whether the robot is driven: its command has not expired, or its expiry is not yet reported."""
        return address in self._until

    def driven(self) -> list[str]:
        """Return the robots that are being driven."""
        return list(self._until)

    def expired(self, uptime_s: float) -> list[str]:
        """Return the robots to stop now, each once."""
        stop = [address for address, until_s in self._until.items() if until_s <= uptime_s]
        for address in stop:
            del self._until[address]
        return stop

    def next_due_s(self) -> float | None:
        """Return the uptime of the next expiry."""
        return next(iter(self._until.values()), None)


class Brakes:
    """Drives and stops robots. Its thread runs in the outermost of its contexts; methods are thread-safe."""

    def __init__(self, swarm: Swarm) -> None:
        self.held = False
        self._swarm = swarm
        self._joysticks = Joysticks()
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._over = False
        self._entered = 0
        self._thread = threading.Thread(target=self._watch, name="brakes", daemon=True)

    def __enter__(self) -> Self:
        self._entered += 1
        if self._entered == 1:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._entered -= 1
        if self._entered:
            return
        self._over = True
        self._wake.set()
        self._thread.join(1.0)  # a driver that hangs must not hold up the end

    def hold(self, held: bool = True) -> None:
        """Stop every robot and refuse commands (emergency stop), or with `held` false let robots move again."""
        self.held = held
        self._wake.set()

    def refuse_if_held(self) -> None:
        """Raise `Held` while all robots are stopped."""
        if self.held:
            raise Held("the operator has stopped all robots")

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn a robot's wheels until the command expires, or stop it. Raises: Held; Unknown; errors of a driver."""
        if not (left_pct or right_pct):
            # Disarmed last: a driver that fails may have left the wheels turning.
            self._swarm.drive(address, 0, 0)
            self._arm(address, False)
            return
        self.refuse_if_held()
        self._arm(address, True)  # first, for the same reason
        try:
            self._swarm.drive(address, left_pct, right_pct)
        finally:
            with self._lock:
                is_late = not self._joysticks.is_driven(address)
            # The command expired before the driver returned, so the driver may have acted after the stop.
            if is_late and not self._attempt(address, partial(self._swarm.stop, address)):
                self._arm(address, True)

    def stop(self, address: str) -> None:
        """Stop a robot, whatever it is doing. Raises: Unknown; errors of a driver."""
        self._swarm.stop(address)
        self._arm(address, False)  # last: a driver that fails may have left the wheels turning

    def end_joystick(self, address: str) -> None:
        """Note that a robot follows a route: its joystick command no longer expires."""
        self._arm(address, False)

    def _arm(self, address: str, moving: bool) -> None:
        with self._lock:
            self._joysticks.drive(address, moving, time.monotonic())
        if moving:
            self._wake.set()

    def _watch(self) -> None:
        held = False
        while not self._over:
            now_s = time.monotonic()
            with self._lock:
                abandoned = self._joysticks.expired(now_s)
                due_s = self._joysticks.next_due_s()
            if self.held:
                held = True
                self._attempt("all", self._swarm.hold)
            elif held:
                held = not self._attempt("all", self._swarm.release)
            for address in abandoned:
                if not self._attempt(address, partial(self._swarm.stop, address)):
                    self._arm(address, True)
            wait_s = AGAIN_S if due_s is None else min(AGAIN_S, due_s - time.monotonic())
            self._wake.wait(max(0.0, wait_s))
            self._wake.clear()
        # After this thread ends, nothing would stop them.
        with self._lock:
            driven = self._joysticks.driven()
        for address in driven:
            self._attempt(address, partial(self._swarm.stop, address))

    def _attempt(self, target: str, act: Callable[[], None]) -> bool:
        try:
            act()
        except Unknown:
            log.debug("%s left while being driven", target)
        except Exception as error:  # noqa: BLE001  # one driver's failure must not keep others from being stopped
            log.error("%s: stopping failed (%s), retrying", target, type(error).__name__)  # noqa: TRY400
            return False
        return True


class KeptStop:
    """A file that exists while all robots are stopped; without a path nothing is stored. Thread-safe."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._lock = threading.Lock()

    def was_held(self) -> bool:
        """Return whether all robots were stopped when the last gateway with this file ended."""
        return self._path is not None and os.path.lexists(self._path)

    def keep(self, held: Callable[[], bool]) -> None:
        """Store the current state; if that fails, log what a restart would forget."""
        if self._path is None:
            return
        with self._lock:  # so the last caller stores the latest state
            try:
                if held():
                    os.close(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600))
                else:
                    self._path.unlink(missing_ok=True)
            except OSError as error:
                why = error.strerror
                log.warning("%s: %s; a restart will forget that robots were stopped or released", self._path, why)
