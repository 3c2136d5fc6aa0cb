"""A folder in which a child's files lie: ours alone, and gone when we are."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

PREFIX = "phalanx-broker-"
LOCK = ".lock"
YOUNG_S = 10.0


@contextlib.contextmanager
def private_folder() -> Iterator[Path]:
    """A new folder that nobody else may enter, for as long as the context lasts.

    Folders that killed gateways left behind are removed first: nobody holds their lock.
    """
    _sweep()
    with tempfile.TemporaryDirectory(prefix=PREFIX) as folder, (Path(folder) / LOCK).open("w") as lock:
        os.fchmod(lock.fileno(), 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield Path(folder)


def _sweep() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            made = folder.lstat()
            # Only our own: everybody may write to that place, and lay a trap. And none that is being made just now.
            if made.st_uid != os.geteuid() or not stat.S_ISDIR(made.st_mode) or time.time() - made.st_mtime < YOUNG_S:
                continue
            with (folder / LOCK).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
