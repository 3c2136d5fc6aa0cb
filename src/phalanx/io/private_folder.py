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

OURS, PREFIX = "phalanx-", "phalanx-broker-"
CONFIG = "mosquitto.conf"
LOCK = ".lock"
YOUNG_S = 10.0


@contextlib.contextmanager
def private_folder() -> Iterator[Path]:
    """A new folder that nobody else may enter, for as long as the context lasts."""
    with tempfile.TemporaryDirectory(prefix=PREFIX) as folder, (Path(folder) / LOCK).open("w") as lock:
        os.fchmod(lock.fileno(), 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield Path(folder)


def sweep() -> None:
    """Remove the folders that killed gateways left behind.

    No living process holds their lock, or is started from them, where an older one made no lock.
    """
    for folder in Path(tempfile.gettempdir()).glob(f"{OURS}*"):
        with contextlib.suppress(OSError):
            made = folder.lstat()
            # Only our own: everybody may write to that place, and lay a trap. And none that is being made just now.
            if made.st_uid != os.geteuid() or not stat.S_ISDIR(made.st_mode) or time.time() - made.st_mtime < YOUNG_S:
                continue
            if not (folder / LOCK).exists():
                # What else is called so, a cache of ours or a test's, has no such file in it.
                if (folder / CONFIG).exists() and not _is_told_of(folder):
                    shutil.rmtree(folder, ignore_errors=True)
                continue
            with (folder / LOCK).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)


def _is_told_of(folder: Path) -> bool:
    """Whether a living process was started with this folder's name among its words, as a broker is."""
    for words in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if os.fsencode(folder) in words.read_bytes():
                return True
    return False
