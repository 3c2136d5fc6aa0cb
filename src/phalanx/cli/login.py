"""The broker's login, out of a file or the environment: only this package reads that."""

from __future__ import annotations

import os
from pathlib import Path

from phalanx.errors import UsageError
from phalanx.io import Login


def read_login(path: Path | None) -> Login | None:
    """The broker's login from a file or the environment, or None.

    Raises: UsageError: the file cannot be read or holds no user:password. Never repeats what is in it.
    """
    if path is not None:
        try:
            with path.open() as file:  # not more of it than a login has: it may be a device
                lines = file.read(4096).splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not text"
            raise UsageError(f"cannot read {path}: {reason}", "a file with one line user:password") from error
        username, colon, password = lines[0].partition(":") if lines else ("", "", "")
        if not (username and colon):
            raise UsageError(f"{path} does not hold user:password", "one line, the name first")
        return Login(username, password)
    username = os.environ.get("PHALANX_BROKER_USERNAME", "")
    return Login(username, os.environ.get("PHALANX_BROKER_PASSWORD", "")) if username else None
