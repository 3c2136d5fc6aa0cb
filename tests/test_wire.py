"""The byte table: what is encoded is decoded again, whatever else is a PeerError, and what is made from it is current."""

from __future__ import annotations

import dataclasses
import math
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.errors import PeerError, UsageError
from phalanx.wire import MalformedRecord, Record, table
from phalanx.wire.typed_records import Command, Reading, State
from scripts import loaded

ROOT = Path(__file__).parent.parent
# So many of each record: what goes wrong with a type of field is found in any of them.
FEW = settings(deadline=None, max_examples=10)
EACH = pytest.mark.parametrize("record", table.RECORDS, ids=lambda record: record.name)
NUMBERS = st.floats(-1e6, 1e6, width=32)
VALUES = {
    "u8": st.integers(0, 2**8 - 1),
    "u16": st.integers(0, 2**16 - 1),
    "u32": st.integers(0, 2**32 - 1),
    "u64": st.integers(0, 2**64 - 1),
    "f32": NUMBERS,
    "v8": st.binary(max_size=255),
    "v16": st.binary(max_size=300),
    "rest": st.binary(max_size=300),
    **{f"b{size}": st.binary(min_size=size, max_size=size) for size in (4, 8, 16, 20, 32, 48, 64, 99, 128, 576)},
    "i8": st.integers(-(2**7), 2**7 - 1),
    "i16": st.integers(-(2**15), 2**15 - 1),
    "i32": st.integers(-(2**31), 2**31 - 1),
    "i64": st.integers(-(2**63), 2**63 - 1),
    "f64": st.floats(allow_nan=False),
    "f64?": st.floats(allow_nan=False),
}


def values_of(record: Record, data) -> dict:
    return {f.name: data.draw(VALUES[f.type]) for f in record.all_fields if f.value is None}


@EACH
@FEW
@given(data=st.data())
def test_what_is_encoded_is_decoded_again(record, data):
    values = values_of(record, data)
    raw = record.encode(**values)
    assert record.decode(raw) == values
    assert record.encode(**record.decode(raw)) == raw
    assert len(raw) >= record.size


@EACH
@FEW
@given(data=st.data())
def test_a_byte_less_or_more_is_refused(record, data):
    raw = record.encode(**values_of(record, data))
    with pytest.raises(MalformedRecord):
        record.decode(raw[: record.size - 1])
    if record.all_fields[-1].type != "rest":
        with pytest.raises(MalformedRecord):
            record.decode(raw[:-1])
        with pytest.raises(MalformedRecord):
            record.decode(raw + b"\0")
        assert record.read(raw + b"\0") == (record.decode(raw), len(raw))


@EACH
@FEW
@given(raw=st.binary(max_size=400))
def test_garbage_is_a_peer_error_or_a_record(record, raw):
    try:
        values = record.decode(raw)
    except PeerError as error:
        assert error.reason == "malformed_record"
    else:
        assert record.encode(**values) == raw


@pytest.mark.parametrize("record", [r for r in table.RECORDS if r.tag is not None], ids=lambda record: record.name)
@FEW
@given(data=st.data())
def test_another_tag_is_refused(record, data):
    raw = record.encode(**values_of(record, data))
    other = bytes([data.draw(VALUES["u8"].filter(lambda tag: tag != record.tag))])
    with pytest.raises(MalformedRecord, match="tag"):
        record.decode(other + raw[1:])


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1.1e6, -1.1e6])
def test_numbers_that_spoil_sums_are_never_read_or_written(number):
    good = {"id": 1, "t": 0, "x_m": 0.0, "y_m": 0.0, "vx_mps": 0.0, "vy_mps": 0.0}
    raw = bytearray(table.STATE.encode(**good))
    at = table.STATE.at("vx_mps")
    raw[at : at + 4] = struct.pack("<f", number)
    with pytest.raises(MalformedRecord, match="vx_mps"):
        table.STATE.decode(bytes(raw))
    with pytest.raises(UsageError, match="vx_mps"):
        table.STATE.encode(**good | {"vx_mps": number})


@pytest.mark.parametrize(
    "wrong",
    [
        {"t": -1},
        {"t": 2**32},
        {"type": 256},
        {"payload": bytes(65_536)},
        {"payload": "text"},
        {"type": 1.5},
        {"more": 1},
    ],
    ids=str,
)
def test_values_that_do_not_fit_are_our_own_fault(wrong):
    with pytest.raises(UsageError, match="entry"):
        table.ENTRY.encode(**{"type": 1, "t": 5, "payload": b"x"} | wrong)


def test_a_field_that_is_missing_or_unknown_is_our_own_fault():
    with pytest.raises(UsageError, match="payload"):
        table.ENTRY.encode(type=1, t=5)
    with pytest.raises(UsageError, match="no field"):
        table.ENTRY.at("sender")


def test_sizes_are_the_papers():
    # RoboRebound §5.2: 34 B for a sensor reading or a state in the log, 26 B for a command.
    assert table.STATE.size == table.SENSOR.size == 27
    assert table.ACCELERATION.size == 19
    assert table.ENTRY_HEADER_BYTES == 7
    assert len(table.ENTRY.encode(type=table.ENTRY_INPUT, t=0, payload=bytes(27))) == 34


def test_whatever_is_maced_begins_with_a_tag_of_its_own():
    assert all(record.tag is not None for record in table.MACED)
    kinds = {record.name.removesuffix("_paper"): record.tag for record in table.MACED}
    assert len(set(kinds.values())) == len(kinds)
    assert not set(kinds.values()) & {table.ENTRY_INPUT, table.ENTRY_RECV, table.ENTRY_SEND, table.ENTRY_ACMD}


def test_the_c_header_the_pages_module_and_the_dataclasses_are_made_from_the_table():
    make = loaded(ROOT / "firmware" / "generate.py")
    assert make.HEADER.read_text() == make.c_header()
    assert make.LINE_HEADER.read_text() == make.line_header()
    assert make.PAGES.read_text() == make.for_pages()
    assert make.TYPED.read_text() == make.dataclasses()


@pytest.mark.parametrize("kind", [Reading, Command, State], ids=lambda kind: kind.__name__)
@FEW
@given(data=st.data())
def test_a_dataclass_has_the_bytes_of_its_record(kind, data):
    values = values_of(kind.RECORD, data)
    raw = kind.RECORD.encode(**values)
    typed = kind(**values)
    assert kind.decode(raw) == typed
    assert typed.encode() == raw
    left_out = dataclasses.replace(typed, id=0, t=0)
    assert left_out.encode(values["id"], values["t"]) == raw
    for wrong in (raw[:-1], raw + b"\0", b"\0" + raw[1:], b""):
        with pytest.raises(MalformedRecord):
            kind.decode(wrong)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1.1e6, -1.1e6, 1e39, "far", None])
def test_a_dataclass_neither_reads_nor_writes_such_numbers(number):
    with pytest.raises(UsageError, match="ax_mps2"):
        Command(number, 0.0).encode(1, 0)
    if (isinstance(number, float) and abs(number) < 1e39) or number != number:
        raw = table.ACCELERATION.form.pack(table.ACCELERATION.tag, 1, 0, 0.0, number)
        with pytest.raises(MalformedRecord):
            Command.decode(raw)


@pytest.mark.parametrize("rob_id", [-1, 65_536, "7"])
def test_a_dataclass_writes_no_id_that_no_robot_has(rob_id):
    with pytest.raises(UsageError, match="state"):
        State(0.0, 0.0, 0.0, 0.0, id=rob_id).encode()


def test_the_tables_of_the_specification_are_made_from_the_table():
    make = loaded(ROOT / "firmware" / "generate.py")
    for path in (make.SPEC / name for name in make.BLOCKS):
        assert path.read_text() == make.page(path)
