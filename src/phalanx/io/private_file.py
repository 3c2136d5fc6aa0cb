"""Files that are written whole or not at all, and those that only their owner may read."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from phalanx.errors import Unavailable, UsageError


def write_whole(path: Path, data: bytes, hint: str, *, private: bool = False) -> None:
    """The file has these bytes, or what it had. In a folder that is shared nobody's link is followed.

    Raises: Unavailable: it cannot be written.
    """
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        made = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if private else 0o666)
        with os.fdopen(made, "wb") as file:
            file.write(data)
        beside.replace(path)
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}", hint) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()


def write_private(path: Path, data: bytes, *, replace: bool = False) -> None:
    """A file for its owner alone, whole or not at all, and on disk when this returns.

    Raises: UsageError: it is there already and is not to be replaced; Unavailable: it cannot be written.
    """
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if replace:
            beside.replace(path)
        else:
            os.link(beside, path)  # unlike a rename, not over what is there
            beside.unlink()
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except FileExistsError as error:
        beside.unlink(missing_ok=True)
        raise UsageError(f"{path} is there already", "another name") from error
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise Unavailable(
            f"cannot write {path}: {error.strerror}", "a folder that is yours, with room in it"
        ) from error
