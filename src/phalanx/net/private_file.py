"""Atomic writing of files, and files and folders that only their owner may read."""

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
YOUNG_S = 10.0  # age below which a folder may still be without its lock


def write_whole(path: Path, data: bytes, hint: str, *, private: bool = False) -> None:
    """Replace a file atomically, without following a symbolic link. Raises: Unavailable: it cannot be written."""
    _write(path, data, hint, 0o600 if private else 0o666)


def write_private(path: Path, data: bytes, *, replace: bool = False) -> None:
    """Write a file for its owner alone, atomically and durably.

    Raises: UsageError: it exists and `replace` is false; Unavailable: it cannot be written.
    """
    hint = "use a folder that you own, on a disk with free space"
    _write(path, data, hint, 0o600, replace=replace, on_disk=True)


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
            os.link(beside, path)  # unlike a rename, it does not replace an existing file
            beside.unlink()
        if on_disk:
            sync_name(path)
    except FileExistsError as error:
        raise UsageError(f"{path} exists already", "use another name") from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}", hint) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()


def sync_name(path: Path) -> None:
    """Flush the directory entry of a new file to disk. Raises: OSError."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def is_ours_alone(status: os.stat_result) -> bool:
    """Return whether this user owns a file or folder, and no other user has access."""
    return status.st_uid == os.geteuid() and not status.st_mode & 0o077


def check_private(path: Path, status: os.stat_result) -> None:
    """Raise UsageError unless `path` is a regular file that only this user may access."""
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"{path} is not a regular file", "use the name of a file; a missing file is created")
    if not is_ours_alone(status):
        raise UsageError(f"other users may read {path}", f"chmod 600 {path}, or use another file that you own")


@contextlib.contextmanager
def private_folder() -> Iterator[Path]:
    """Yield a new folder that no other user may enter, and remove it at the end."""
    with tempfile.TemporaryDirectory(prefix=PREFIX) as folder, (Path(folder) / LOCK).open("w") as lock:
        os.fchmod(lock.fileno(), 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield Path(folder)


def sweep() -> None:
    """Remove folders of killed gateways: those whose lock no process holds."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            made = folder.lstat()
            # Only folders of this user, as everybody may write to /tmp; and none that is just being created.
            if made.st_uid != os.geteuid() or not stat.S_ISDIR(made.st_mode) or time.time() - made.st_mtime < YOUNG_S:
                continue
            with (folder / LOCK).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
