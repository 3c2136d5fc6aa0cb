"""The store of sessions on disk: private, for one gateway, whole after a kill at any moment, clear when damaged."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from phalanx.config.session import SessionConfig
from phalanx.errors import Unavailable, UsageError
from phalanx.link.session.visitors import Visitors
from phalanx.net.session_store import SessionStore

# Adds and removes visitors for ever; says on stdout what the server would acknowledge, after `remove` has returned.
REMOVES = """
import itertools, sys
from pathlib import Path
from phalanx.net.session_store import SessionStore
from phalanx.link.session.visitors import Visitor, Visitors
from phalanx.link.session import Role
from phalanx.config.session import SessionConfig

store = SessionStore(Path(sys.argv[1]))
visitors = Visitors(SessionConfig(), store)
print("up", flush=True)
for n in itertools.count():
    secret, pending = n.to_bytes(16) + bytes(15) + b"a", n.to_bytes(16) + bytes(15) + b"b"
    made = Visitor(0, "Ada", Role.DRIVE, False, frozenset(), bytes(8), 1 << 40, secret, pending)
    known = visitors.admit(made, {}, 0)
    if n % 3:
        visitors.remove({known.id}, approval=True)
        print(known.id, flush=True)
"""


def a_child(path: Path) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", REMOVES, str(path)], stdout=subprocess.PIPE, text=True)


@pytest.mark.waits
def test_no_acknowledged_removal_is_undone_by_a_kill_at_any_moment(tmp_path):
    path, removed, chance = tmp_path / "sessions.db", set[int](), random.Random(31)
    keys = None
    for _ in range(8):
        child = a_child(path)
        assert child.stdout is not None
        assert child.stdout.readline() == "up\n"
        time.sleep(chance.uniform(0.0, 0.4))
        os.kill(child.pid, signal.SIGKILL)
        said = child.stdout.read().split("\n")
        child.wait()
        removed |= {int(line) for line in said[:-1]}  # the last line may be cut off
        with SessionStore(path) as store:
            visitors = Visitors(SessionConfig(), store)
            assert not removed & {each.id for each in visitors}
            assert not removed or visitors.approval
            raw = store.keys.static.private_bytes_raw(), store.keys.signer.private_bytes_raw()
            assert keys in (None, raw), "the swarm's keys survive as well"
            keys = raw
    assert len(removed) > 20, "or it shows nothing"


def test_rows_are_written_together_and_deleted(tmp_path):
    with SessionStore(tmp_path / "s.db") as store:
        store.write({b"a": b"1", b"b": b"2"})
        store.write({b"a": None, b"b": b"3", b"c": None})
        assert store.load() == {b"b": b"3"}
        with pytest.raises(sqlite3.ProgrammingError):
            store.write({b"d": b"4", b"e": object()})
        store.write({b"f": b"5"})
    with SessionStore(tmp_path / "s.db") as store:
        assert store.load() == {b"b": b"3", b"f": b"5"}


def test_only_its_owner_reads_it_and_what_stands_beside_it(tmp_path):
    before = os.umask(0)
    try:
        with SessionStore(tmp_path / "s.db") as store:
            store.write({b"a": b"1"})
            modes = {each.name: each.stat().st_mode & 0o777 for each in tmp_path.iterdir()}
    finally:
        os.umask(before)
    assert modes
    assert set(modes.values()) == {0o600}, modes


def test_a_file_that_others_may_read_is_refused(tmp_path):
    SessionStore(tmp_path / "s.db").close()
    (tmp_path / "s.db").chmod(0o640)
    with pytest.raises(UsageError, match="other users may read") as refused:
        SessionStore(tmp_path / "s.db")
    assert "chmod 600" in refused.value.hint


def test_a_link_to_another_place_is_not_followed(tmp_path):
    (tmp_path / "elsewhere").write_bytes(b"")
    (tmp_path / "s.db").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(Unavailable, match=r"cannot open .*s\.db"):
        SessionStore(tmp_path / "s.db")


def test_a_second_gateway_is_refused_and_comes_in_after_the_first(tmp_path):
    with SessionStore(tmp_path / "s.db") as first:
        with pytest.raises(Unavailable, match="another gateway uses"):
            SessionStore(tmp_path / "s.db")
        first.write({b"a": b"1"})
    with SessionStore(tmp_path / "s.db") as second:
        assert second.load() == {b"a": b"1"}


@pytest.mark.parametrize("spoil", ["garbage", "middle", "cut", "keys", "other"])
def test_a_damaged_file_gives_one_clear_line(tmp_path, spoil):
    path = tmp_path / "s.db"
    with SessionStore(path) as store:
        store.write({bytes([i]) * 9: bytes(2000) for i in range(50)})
    whole = path.read_bytes()
    match spoil:
        case "garbage":
            path.write_bytes(b"not a database at all" * 500)
        case "middle":
            path.write_bytes(whole[:4096] + os.urandom(4096 * 3) + whole[4096 * 4 :])
        case "cut":
            path.write_bytes(whole[: len(whole) // 2])
        case "keys":
            with closing(sqlite3.connect(path)) as db, db:
                db.execute("DELETE FROM keys WHERE name = 'signer'")
        case "other":
            path.write_bytes(b"")
            with closing(sqlite3.connect(path)) as db, db:
                db.execute("CREATE TABLE rows (a)")
    with pytest.raises(UsageError) as refused:
        SessionStore(path)
    words = "is not a session store" if spoil == "other" else "is damaged"
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_neither_keys_nor_store_print_a_secret(tmp_path):
    with SessionStore(tmp_path / "s.db") as store:
        raw = store.keys.static.private_bytes_raw(), store.keys.signer.private_bytes_raw()
        shown = repr(store) + repr(store.keys) + str(vars(type(store.keys)))
    for each in raw:
        assert repr(each)[2:-1] not in shown
        assert each.hex() not in shown
