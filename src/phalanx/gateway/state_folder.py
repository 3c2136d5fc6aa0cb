"""A gateway's state folder: the store of sessions, the trail, and the address of its operator's page.

Only one gateway uses it at a time. Only its owner may have access.
"""

from __future__ import annotations

import contextlib
import json
import logging
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from phalanx.errors import Unavailable, UsageError
from phalanx.link.session import MemoryStore, Store
from phalanx.net.private_file import is_ours_alone, write_private
from phalanx.net.session_store import LinkKeys, SessionStore, new_link_keys

from .trail import Trail

log = logging.getLogger(__name__)

STORE, TRAIL, OPERATOR = "sessions.db", "trail.jsonl", "operator.json"


@dataclass(frozen=True, slots=True)
class StoredState:
    """A gateway's stored state, in a folder or in memory."""

    store: Store
    keys: LinkKeys
    trail: Trail
    folder: Path | None

    @contextlib.contextmanager
    def publish_operator_url(self, operator_url: str) -> Iterator[None]:
        """Publish the operator's address to commands of this user while the context lasts."""
        if self.folder is None:
            yield
            return
        path = self.folder / OPERATOR
        write_private(path, json.dumps({"url": operator_url}).encode(), replace=True)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                path.unlink()


@contextlib.contextmanager
def open_state(folder: Path | None, *, is_optional: bool = False) -> Iterator[StoredState]:
    """Open the folder, created if missing. None, or an optional folder that is unavailable: keep state in memory.

    Raises: UsageError: it is damaged, or others have access; Unavailable: another gateway uses it.
    """
    with contextlib.ExitStack() as stack:
        store = None
        if folder is not None:
            try:
                make_folder(folder)
                store = stack.enter_context(SessionStore(folder / STORE))
            except Unavailable as error:
                if not is_optional:
                    raise
                log.warning("%s: this gateway will not keep its visitors; hint: use --state FOLDER", error)
        if folder is None or store is None:
            yield StoredState(MemoryStore(), new_link_keys(), Trail(None), None)
            return
        trail = Trail(folder / TRAIL)
        stack.callback(trail.close)
        yield StoredState(store, store.keys, trail, folder)


def make_folder(folder: Path) -> None:
    """Create a folder that only its owner can access, if missing. Raises: UsageError; Unavailable."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        made = folder.lstat()
    except OSError as error:
        raise Unavailable(f"cannot create {folder}: {error.strerror}", "use --state with your own folder") from error
    if not stat.S_ISDIR(made.st_mode):
        raise UsageError(f"{folder} is not a folder", "use --state with a folder; a missing one is created")
    if not is_ours_alone(made):
        raise UsageError(f"other users have access to {folder}", f"run chmod 700 {folder}, or use another folder")


def operator_url_in(folder: Path) -> str:
    """Return the address of the operator's page for this folder. Raises: Unavailable: no gateway runs."""
    try:
        url = json.loads((folder / OPERATOR).read_bytes())["url"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        hint = "start phalanx up, or give its folder with --state FOLDER"
        raise Unavailable(f"no gateway runs with {folder}", hint) from error
    return str(url)
