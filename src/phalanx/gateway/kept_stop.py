"""The operator's stop on disk, so that a gateway that was killed and started again still holds all robots."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path

log = logging.getLogger(__name__)


class KeptStop:
    """A file that is there while all robots are stopped; without a path nothing is kept. For any thread."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._lock = threading.Lock()

    def was_held(self) -> bool:
        """Whether the last gateway with this file ended, in whatever way, while all robots were stopped."""
        return self._path is not None and os.path.lexists(self._path)

    def keep(self, held: Callable[[], bool]) -> None:
        """Put on disk what is so now; if that fails the log says what a restart would forget."""
        if self._path is None:
            return
        with self._lock:  # whoever comes last asks last
            try:
                if held():
                    os.close(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600))
                else:
                    self._path.unlink(missing_ok=True)
            except OSError as error:
                why = error.strerror
                log.warning("%s: %s; a restart forgets that you stopped robots, or let them go", self._path, why)
