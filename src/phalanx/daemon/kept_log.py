"""All that was ever in a robot's log, in a file: a line of JSON, and the log's bytes behind it, as they were chained.

A c-node forgets what its auditors have covered. The file is evidence for whoever reads it later, and nothing in the
robot's life depends on it. It is written as it comes, unbuffered: who is killed flushes nothing. A file that was
cut short is read up to there.
"""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from phalanx.bti.fleet import Fleet
from phalanx.errors import Unavailable


class KeptLog:
    """The file, from the mission's beginning; one of an earlier mission is kept beside it. Use as `with`."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        self._path, self._head = path, head
        self._file: io.RawIOBase | None = None
        self._seen = 0

    def __enter__(self) -> Self:
        try:
            if self._path.exists():
                self._path.replace(self._path.with_suffix(".before.log"))
            self._file = os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", 0)
            self._file.write(json.dumps(self._head).encode() + b"\n")
        except OSError as error:
            raise self._unwritable(error) from error
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        assert self._file
        try:
            self._file.close()
        except OSError as error:
            raise self._unwritable(error) from error

    def keep(self, fleet: Fleet) -> None:
        """What is new in the only robot's log; called after each event: one lengthens or shortens it, not both."""
        assert self._file
        length = int(fleet.robot[0].log_len)
        if length > self._seen:
            try:
                self._file.write(fleet.log[0, self._seen : length].tobytes())
            except OSError as error:
                raise self._unwritable(error) from error
        self._seen = length

    def _unwritable(self, error: OSError) -> Unavailable:
        return Unavailable(f"cannot write {self._path}: {error.strerror}", "another folder")
