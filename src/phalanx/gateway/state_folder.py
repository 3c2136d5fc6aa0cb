"""The folder that a gateway keeps: the store of sessions, the trail, and where its operator's page is.

Only one gateway has it at a time. Nobody but its owner may enter it.
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
class Kept:
    """What a gateway keeps, or forgets with its end."""

    store: Store
    keys: LinkKeys
    trail: Trail
    folder: Path | None

    @contextlib.contextmanager
    def found_at(self, operator_url: str) -> Iterator[None]:
        """Let commands of this user find the operator's page while the context lasts."""
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
def kept_in(folder: Path | None, *, is_optional: bool = False) -> Iterator[Kept]:
    """Open the folder, made if it is not there. None: nothing is kept, nor if an optional one cannot be had.

    Raises: UsageError: it is damaged, or others may enter it; Unavailable: another gateway has it.
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
                log.warning("%s: this one forgets its visitors with its end; hint: --state FOLDER", error)
        if folder is None or store is None:
            yield Kept(MemoryStore(), new_link_keys(), Trail(None), None)
            return
        trail = Trail(folder / TRAIL)
        stack.callback(trail.close)
        yield Kept(store, store.keys, trail, folder)


def make_folder(folder: Path) -> None:
    """Make a folder for its owner alone, if it is not there. Raises: UsageError; Unavailable."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        made = folder.lstat()
    except OSError as error:
        raise Unavailable(f"cannot make {folder}: {error.strerror}", "--state FOLDER, one of your own") from error
    if not stat.S_ISDIR(made.st_mode):
        raise UsageError(f"{folder} is no folder", "--state FOLDER, one that is not there is made")
    if not is_ours_alone(made):
        raise UsageError(f"others may enter {folder}", f"chmod 700 {folder}, or another folder of your own")


def operator_url_in(folder: Path) -> str:
    """Return where the operator's page of the gateway with this folder is. Raises: Unavailable: none runs."""
    try:
        url = json.loads((folder / OPERATOR).read_bytes())["url"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        hint = "start phalanx up, or say its folder: --state FOLDER"
        raise Unavailable(f"no gateway runs with {folder}", hint) from error
    return str(url)
