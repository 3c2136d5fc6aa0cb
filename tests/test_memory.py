"""Fields and copies in one instruction are what they are byte by byte, compiled and not; sparse rows take no memory."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.bti import log
from phalanx.bti.fleet import ROBOT, SETTINGS, records
from phalanx.pool import borrow, give_back, make_pool, sparse
from phalanx.wire import fields

ROOM = 24
ROWS = st.binary(min_size=ROOM, max_size=ROOM)
PLACES = st.integers(0, ROOM - 8)
FORMS = {"u16": "<H", "u32": "<I", "u64": "<q"}


def both(kernel):
    """A kernel, compiled and not; of what the compiler writes inline (tests/compiler), the function alone."""
    return kernel, getattr(kernel, "py_func", kernel)


@pytest.mark.parametrize("name", FORMS)
@given(ROWS, PLACES)
def test_a_number_is_read_as_it_lies(name, raw, at):
    right = struct.unpack_from(FORMS[name], raw, at)[0]
    assert {get(fields.row(raw), at) for get in both(getattr(fields, f"get_{name}"))} == {right}


@pytest.mark.parametrize("name", FORMS)
def test_a_number_that_the_row_cuts_off_is_refused(name):
    for cut in range(1, struct.calcsize(FORMS[name]) + 1):
        row = fields.row(bytes(ROOM))
        at = ROOM - struct.calcsize(FORMS[name]) + cut
        with pytest.raises((IndexError, ValueError)):
            getattr(fields, f"get_{name}")(row, at)
        with pytest.raises((IndexError, ValueError)):
            getattr(fields, f"put_{name}")(row, at, 0)


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("at", [-1, -3, -9, -ROOM, 1 << 62])
def test_no_number_lies_before_a_row_or_far_behind_it(name, at):
    row = fields.row(bytes(range(ROOM)))
    with pytest.raises(IndexError):
        getattr(fields, f"get_{name}")(row, at)
    with pytest.raises(IndexError):
        getattr(fields, f"put_{name}")(row, at, 0)
    assert row.tobytes() == bytes(range(ROOM))


@pytest.mark.parametrize(("at", "length"), [(-9, 4), (ROOM - 1, 2), (ROOM + 1, 1)])
def test_bytes_outside_a_row_are_neither_copied_nor_alike(at, length):
    row = fields.row(bytes(range(ROOM)))
    with pytest.raises(IndexError):
        fields.same(row, at, row, at, length)
    with pytest.raises(IndexError):
        fields.move(row, at, row, 0, length)
    with pytest.raises(IndexError):
        fields.move(row, 0, row, at, length)
    assert row.tobytes() == bytes(range(ROOM))


@pytest.mark.parametrize("name", FORMS)
@given(ROWS, PLACES, st.integers(0, (1 << 63) - 1))
def test_a_number_is_written_cut_to_its_width_and_nothing_beside_it(name, raw, at, value):
    width = struct.calcsize(FORMS[name])
    right = raw[:at] + (value & (1 << 8 * width) - 1).to_bytes(width, "little") + raw[at + width :]
    for put in both(getattr(fields, f"put_{name}")):
        row = fields.row(raw)
        put(row, at, value)
        assert row.tobytes() == right


# Compiled code has a way of its own for 16 to 32 bytes, one for up to 64, and one for more.
@pytest.mark.parametrize("length", [-3, 0, 1, 15, 16, 17, 31, 32, 33, 48, 63, 64, 65, 80])
@given(st.data())
def test_bytes_are_copied_within_a_row_as_if_by_way_of_another(length, data):
    room = 100
    raw = data.draw(st.binary(min_size=room, max_size=room))
    to, source = data.draw(st.tuples(*[st.integers(0, room - max(length, 0))] * 2))
    right = bytearray(raw)
    right[to : to + max(length, 0)] = raw[source : source + max(length, 0)]
    for copy in both(fields.copy):
        row = fields.row(raw)
        copy(row, to, row, source, length)
        assert row.tobytes() == right


@given(ROWS, ROWS, st.integers(0, ROOM), st.integers(0, ROOM), st.integers(0, ROOM), st.booleans())
def test_bytes_agree_when_all_do(raw, other, one_at, other_at, length, alike):
    length = min(length, ROOM - max(one_at, other_at))
    if alike:
        other = other[:other_at] + raw[one_at : one_at + length] + other[other_at + length :]
    right = raw[one_at : one_at + length] == other[other_at : other_at + length]
    rows = fields.row(raw), fields.row(other)
    assert {bool(same(rows[0], one_at, rows[1], other_at, length)) for same in both(fields.same)} == {right}


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE


def test_sparse_rows_take_memory_where_they_are_written():
    before = resident_bytes()
    rows = sparse(2000, 100_000)  # 200 MB
    rows[::100, 50_000] = 1
    assert resident_bytes() - before < 10e6
    assert int(rows[:, 50_000].sum()) == 20


@given(st.lists(st.tuples(st.sampled_from(["append", "mark", "cut"]), st.binary(min_size=1, max_size=9)), max_size=30))
def test_a_log_in_two_pieces_is_one_of_bytes(told):
    """Uncompiled: what is compiled is the same (tests/test_plain.py lives whole runs with both)."""
    settings, robot = records(1, SETTINGS), records(1, ROBOT)
    settings[0].log_max, robot[0].checkpoint_at = 40, -1
    f = SimpleNamespace(
        settings=settings, robot=robot, log=np.zeros((1, 16), np.uint8), log_rest=np.zeros((1, 24), np.uint8)
    )
    right = b""
    for what, raw in told:
        if what == "cut" and right:
            robot[0].checkpoint_at = raw[0] % len(right)
            right = right[robot[0].checkpoint_at + 1 :]
            log.truncate.py_func(f, 0)
        elif what == "mark" and len(right) < 40:
            right += raw[:1]
            log.mark.py_func(f, 0, raw[0])
        elif what == "append" and len(right) + len(raw) <= 40:
            right += raw
            log.write.py_func(f, 0, int(robot[0].log_len), fields.row(raw), len(raw))
            robot[0].log_len += len(raw)
        assert log.logged(f, 0) == right
        assert log.logged(f, 0, len(right) // 2, len(right)) == right[len(right) // 2 :]
        shown = np.zeros(50, np.uint8)
        log.read.py_func(f, 0, len(right), shown, 3)
        assert shown[3 : 3 + len(right)].tobytes() == right


def test_too_many_are_a_memory_error():
    with pytest.raises(MemoryError):
        sparse(1 << 40, 1 << 12)


def test_the_row_that_was_given_back_last_is_lent_next_and_nobody_has_the_same():
    for lends, gives in zip(both(borrow), both(give_back), strict=True):
        pool = make_pool(4, 8)
        assert [lends(pool) for _ in range(4)] == [0, 1, 2, 3]
        gives(pool, 2)
        gives(pool, 0)
        assert [lends(pool), lends(pool)] == [0, 2]
        assert pool.left[0] == 0
