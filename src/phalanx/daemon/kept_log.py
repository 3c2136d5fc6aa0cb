"""A robot's complete log in a file: a line of JSON, followed by the log's bytes as they were hashed.

A c-node discards entries that its auditors have covered; the file keeps them as evidence. The robot does not depend on
it: if the disk is full the file ends, and the robot continues. A thread writes it, so a slow disk does not delay
readings. A truncated file is read as far as it goes.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
import threading
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Self

from phalanx.bti import request
from phalanx.bti.fleet import Fleet
from phalanx.bti.log import logged
from phalanx.errors import Unavailable
from phalanx.wire.fields import get_u32
from phalanx.wire.table import PROOF

log = logging.getLogger(__name__)
MOST_WAITING = 20_000  # pieces that wait for the disk: some minutes
LAST_S = 5.0  # to write waiting pieces when the robot ends


class KeptLog:
    """Writer of a log, as a context; an earlier mission's log is kept beside it. Raises: on entering, Unavailable."""

    def __init__(self, path: Path) -> None:
        self._path, self._beside = path, path.with_name(f".{path.name}.{os.getpid()}")
        self._file: io.RawIOBase | None = None
        self._seen = self._asked = 0
        self._waiting: SimpleQueue[bytes] = SimpleQueue()  # b"" is the end
        self._writer = threading.Thread(target=self._write_all, daemon=True)

    def __enter__(self) -> Self:
        try:
            self._beside.unlink(missing_ok=True)
            self._file = os.fdopen(os.open(self._beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
        except OSError as error:
            raise Unavailable(f"cannot write {self._path}: {error.strerror}", "use another folder") from error
        self._writer.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._waiting.put(b"")
        self._writer.join(LAST_S)
        with contextlib.suppress(OSError):
            self._beside.unlink(missing_ok=True)  # if the mission never began

    def begin(self, head: dict[str, Any]) -> None:
        """Write the log's first line when the mission begins."""
        self._write(json.dumps(head).encode() + b"\n")
        try:
            if self._path.exists():
                self._path.replace(self._path.with_suffix(".before.log"))
            self._beside.replace(self._path)
        except OSError as error:
            self._end(error.strerror)

    def keep(self, fleet: Fleet) -> None:
        """Append new entries of the robot's log. Call it after each event, which lengthens or shortens the log.

        For each audit request it also writes the trusted nodes' proof, which can be checked with the mission key.
        """
        robot = fleet.robot[0]
        length, asked = int(robot.log_len), int(robot.requests_sent)
        if length >= self._seen:
            begin = self._seen
            if asked > self._asked:
                shown = fleet.request.rows[0]  # the only one; complete even after it was sent
                begin = min(length, max(begin, int(get_u32(shown, request.AT_SEGMENT_LEN))))
                head = shown[: request.HEAD_BYTES].tobytes()
                self._write(
                    logged(fleet, 0, self._seen, begin) + PROOF.encode(auditor=int(robot.request_to), head=head)
                )
            self._write(logged(fleet, 0, begin, length))
        self._seen, self._asked = length, asked

    def _write(self, raw: bytes) -> None:
        if raw and self._file and self._waiting.qsize() < MOST_WAITING:
            self._waiting.put(raw)
        elif raw and self._file:
            self._end("the disk is too slow")

    def _write_all(self) -> None:
        while raw := self._waiting.get():
            file = self._file
            try:
                if file and file.write(raw) != len(raw):
                    self._end("no room")
            except (OSError, ValueError) as error:  # full, or closed just now
                self._end(getattr(error, "strerror", None))
        if self._file:
            self._file.close()

    def _end(self, why: str | None) -> None:
        file, self._file = self._file, None
        if file:
            log.warning("%s: the log is no longer written: %s", self._path, why)
            with contextlib.suppress(OSError):
                file.close()
