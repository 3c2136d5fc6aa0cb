"""Store of sessions on disk: an sqlite3 file for one gateway at a time, readable by its owner alone.

Rows are durable when `write` returns, so a removed visitor stays removed after a power cut. The file also holds the
swarm's keys: after a restart, codes have the same public key, and sessions go on.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.errors import Unavailable, UsageError

from .private_file import check_private, sync_name

APPLICATION_ID = 0x50484C58  # "PHLX", which identifies the file
FORMAT = 1
KEY_BYTES = 32
WRITABLE = "use a folder that you own, on a disk with free space"
_STATIC, _SIGNER = "static", "signer"


@dataclass(frozen=True, slots=True)
class LinkKeys:
    """A swarm's keys: X25519 for handshakes, Ed25519 for updates. The repr does not show them."""

    static: X25519PrivateKey = field(repr=False)
    signer: Ed25519PrivateKey = field(repr=False)


def new_link_keys() -> LinkKeys:
    """Generate keys."""
    return LinkKeys(X25519PrivateKey.generate(), Ed25519PrivateKey.generate())


class SessionStore:
    """`Store` of `phalanx.link.session` in the file at `path`, which is created if it does not exist; has to be closed.

    Attributes:
        keys: the swarm's keys, generated with the file.

    Raises: UsageError: other users may read it, or it is damaged; Unavailable: in use, or the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        _make_private(path)
        with self._faults():
            # Autocommit: transactions begin and end explicitly.
            self._db = sqlite3.connect(path, timeout=0, isolation_level=None)
        try:
            with self._faults():
                self._open()
                self.keys = self._keys()
        except BaseException:
            self._db.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<SessionStore {self._path}>"

    def load(self) -> dict[bytes, bytes]:
        """Return all rows by their keys."""
        with self._faults():
            return dict(self._db.execute("SELECT key, row FROM rows ORDER BY key"))

    def write(self, rows: Mapping[bytes, bytes | None]) -> None:
        """Write rows, and delete those that are None, in one transaction. Return when all are on disk."""
        with self._faults():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                for key, row in rows.items():
                    if row is None:
                        self._db.execute("DELETE FROM rows WHERE key = ?", (key,))
                    else:
                        self._db.execute("INSERT OR REPLACE INTO rows VALUES (?, ?)", (key, row))
                self._db.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    self._db.execute("ROLLBACK")
                raise

    def close(self) -> None:
        """Close the file, so that another gateway may open it."""
        self._db.close()

    def _open(self) -> None:
        # Only one process: another one would write back visitors that this one has removed.
        self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")
        self._db.execute("PRAGMA secure_delete = ON")  # overwrites secrets of removed visitors
        known = self._number("application_id"), self._number("user_version")
        if known == (0, 0) and not self._db.execute("SELECT name FROM sqlite_master").fetchall():
            self._make()
        elif known != (APPLICATION_ID, FORMAT):
            hint = "use another file; a missing file is created"
            raise UsageError(f"{self._path} is not a session store of this version", hint)
        else:
            self._db.execute("BEGIN IMMEDIATE")  # takes the lock
            self._db.execute("COMMIT")
        if self._db.execute("PRAGMA quick_check").fetchone() != ("ok",):
            raise sqlite3.DatabaseError("the integrity check failed")

    def _make(self) -> None:
        self._db.execute("BEGIN IMMEDIATE")
        self._db.execute("CREATE TABLE rows (key BLOB PRIMARY KEY, row BLOB NOT NULL) WITHOUT ROWID")
        self._db.execute("CREATE TABLE keys (name TEXT PRIMARY KEY, raw BLOB NOT NULL) WITHOUT ROWID")
        for name in (_STATIC, _SIGNER):
            self._db.execute("INSERT INTO keys VALUES (?, ?)", (name, secrets.token_bytes(KEY_BYTES)))
        self._db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._db.execute(f"PRAGMA user_version = {FORMAT}")
        self._db.execute("COMMIT")

    def _number(self, pragma: str) -> int:
        return int(self._db.execute(f"PRAGMA {pragma}").fetchone()[0])

    def _keys(self) -> LinkKeys:
        raw = dict(self._db.execute("SELECT name, raw FROM keys"))
        if sorted(raw) != sorted((_STATIC, _SIGNER)) or any(len(each) != KEY_BYTES for each in raw.values()):
            raise sqlite3.DatabaseError("the swarm's keys are missing")
        return LinkKeys(
            X25519PrivateKey.from_private_bytes(raw[_STATIC]), Ed25519PrivateKey.from_private_bytes(raw[_SIGNER])
        )

    @contextlib.contextmanager
    def _faults(self) -> Iterator[None]:
        """Translate errors of sqlite3, which never contain rows."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise Unavailable(f"another gateway uses {self._path}", "use another folder for this one") from error
            raise Unavailable(f"cannot write {self._path}: {error}", WRITABLE) from error
        except (sqlite3.ProgrammingError, sqlite3.InterfaceError):
            raise  # a bug of this program
        except sqlite3.DatabaseError as error:
            hint = "move it away; then all visitors have to scan a new code, and tickets are void"
            raise UsageError(f"{self._path} is damaged: {error}", hint) from error


def _make_private(path: Path) -> None:
    """Create the file for its owner alone before sqlite3 opens it, without following a symbolic link."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            status = os.fstat(file)
        finally:
            os.close(file)
        # The directory entry must be durable before the first acknowledged row.
        sync_name(path)
    except OSError as error:
        raise Unavailable(f"cannot open {path}: {error.strerror}", WRITABLE) from error
    check_private(path, status)
