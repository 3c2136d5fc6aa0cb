"""Orders to robots that wait to be sent: the newest of each kind to each robot, so that no old one is obeyed late."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any


class Orders:
    """For any thread. `wake` is called, in the thread that orders, when something is to be sent."""

    def __init__(self) -> None:
        self.wake: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._due: dict[tuple[str, str], tuple[tuple[Any, ...], float]] = {}

    def put(self, address: str, about: str, *words: Any, until_s: float = math.inf) -> None:
        """These, in this order, instead of what still waits about the same; nothing after `until_s` of uptime."""
        with self._lock:
            self._due[address, about] = words, until_s
        self.wake()

    def take(self, uptime_s: float) -> list[Any]:
        """What is due, oldest first; it waits no longer."""
        with self._lock:
            due, self._due = self._due, {}
        return [said for words, until_s in due.values() if uptime_s <= until_s for said in words]
