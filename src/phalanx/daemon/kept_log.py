"""All that was ever in a robot's log, in a file: a line of JSON, and the log's bytes behind it, as they were chained.

A c-node forgets what its auditors have covered. The file is evidence for whoever reads it later, and nothing in the
robot's life depends on it: on a disk that is full it ends, and the robot goes on. It is written as it comes,
unbuffered: who is killed flushes nothing. A file that was cut short is read up to there.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from phalanx.bti.fleet import Fleet
from phalanx.errors import Unavailable

log = logging.getLogger(__name__)


class KeptLog:
    """The file, in its place from the mission's beginning; one of an earlier mission is kept beside it. Use as `with`.

    Raises: on entering, Unavailable: the folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._beside = path, path.with_name(f".{path.name}.{os.getpid()}")
        self._file: io.RawIOBase | None = None
        self._seen = 0

    def __enter__(self) -> Self:
        try:
            self._beside.unlink(missing_ok=True)
            self._file = os.fdopen(os.open(self._beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
        except OSError as error:
            raise Unavailable(f"cannot write {self._path}: {error.strerror}", "another folder") from error
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError):
            self._beside.unlink(missing_ok=True)  # a mission that never began
            if self._file:
                self._file.close()

    def begin(self, head: dict[str, Any]) -> None:
        """The mission has begun: this is its log's first line."""
        self._write(json.dumps(head).encode() + b"\n")
        try:
            if self._path.exists():
                self._path.replace(self._path.with_suffix(".before.log"))
            self._beside.replace(self._path)
        except OSError as error:
            self._end(error.strerror)

    def keep(self, fleet: Fleet) -> None:
        """What is new in the only robot's log; called after each event: one lengthens or shortens it, not both."""
        length = int(fleet.robot[0].log_len)
        if length > self._seen:
            self._write(fleet.log[0, self._seen : length].tobytes())
        self._seen = length

    def _write(self, raw: bytes) -> None:
        if self._file is None:
            return
        try:
            if self._file.write(raw) != len(raw):
                self._end("no room")
        except OSError as error:
            self._end(error.strerror)

    def _end(self, why: str | None) -> None:
        log.warning("%s is kept no further: %s", self._path, why)
        with contextlib.suppress(OSError):
            if self._file:
                self._file.close()
        self._file = None
