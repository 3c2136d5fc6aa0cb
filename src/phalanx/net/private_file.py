"""Files that are written whole or not at all, and files and folders that only their owner may read."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from phalanx.errors import Unavailable, UsageError

PREFIX = "phalanx-broker-"
LOCK = ".lock"
YOUNG_S = 10.0


def write_whole(path: Path, data: bytes, hint: str, *, private: bool = False) -> None:
    """Write these bytes, or leave what the file had; follow nobody's link. Raises: Unavailable: it cannot."""
    _write(path, data, hint, 0o600 if private else 0o666)


def write_private(path: Path, data: bytes, *, replace: bool = False) -> None:
    """Write a file for its owner alone, whole or not at all, and on disk when this returns.

    Raises: UsageError: it is there already and is not to be replaced; Unavailable: it cannot be written.
    """
    _write(path, data, "a folder that is yours, with room in it", 0o600, replace=replace, on_disk=True)


def _write(path: Path, data: bytes, hint: str, mode: int, *, replace: bool = True, on_disk: bool = False) -> None:
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(data)
            if on_disk:
                file.flush()
                os.fsync(file.fileno())
        if replace:
            beside.replace(path)
        else:
            os.link(beside, path)  # unlike a rename, not over what is there
            beside.unlink()
        if on_disk:
            sync_name(path)
    except FileExistsError as error:
        raise UsageError(f"{path} is there already", "another name") from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}", hint) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()


def sync_name(path: Path) -> None:
    """Return when the name of a file that was made is on disk. Raises: OSError."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def is_ours_alone(status: os.stat_result) -> bool:
    """Return whether a file or folder is this user's, and closed to all others."""
    return status.st_uid == os.geteuid() and not status.st_mode & 0o077


def check_private(path: Path, status: os.stat_result) -> None:
    """Raise UsageError if what was opened is no file, or not this user's alone."""
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"{path} is no file", "one that is not there is made")
    if not is_ours_alone(status):
        raise UsageError(f"others may read {path}", f"chmod 600 {path}, or another file of your own")


@contextlib.contextmanager
def private_folder() -> Iterator[Path]:
    """A new folder that nobody else may enter, for as long as the context lasts."""
    with tempfile.TemporaryDirectory(prefix=PREFIX) as folder, (Path(folder) / LOCK).open("w") as lock:
        os.fchmod(lock.fileno(), 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield Path(folder)


def sweep() -> None:
    """Remove the folders that killed gateways left behind: no living process holds their lock."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            made = folder.lstat()
            # Only our own: everybody may write to that place, and lay a trap. And none that is being made just now.
            if made.st_uid != os.geteuid() or not stat.S_ISDIR(made.st_mode) or time.time() - made.st_mtime < YOUNG_S:
                continue
            with (folder / LOCK).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
