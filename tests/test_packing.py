"""What a controller remembers becomes bytes and back, whatever its fields are; other bytes are a PeerError."""

from __future__ import annotations

import dataclasses
import math
import struct
from dataclasses import dataclass, make_dataclass
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.errors import PeerError
from phalanx.wire.packing import Packing, Unfit
from phalanx.wire.record import MalformedRecord
from phalanx.wire.typed_records import State
from phalanx.wire.widths import F32, F64, I8, I16, I32, I64, U8, U16, U32, U64

INTEGERS = {int: (64, True), **{each: (8 << n, False) for n, each in enumerate((U8, U16, U32, U64))}}
INTEGERS |= {each: (8 << n, True) for n, each in enumerate((I8, I16, I32, I64))}


def whole_numbers(bits: int, signed: bool):
    return st.integers(-(1 << bits - 1), (1 << bits - 1) - 1) if signed else st.integers(0, (1 << bits) - 1)


# Types of a field, each with the values that it may have.
NUMBERS = st.sampled_from(
    [
        *((kind, whole_numbers(*width)) for kind, width in INTEGERS.items()),
        (bool, st.booleans()),
        (float, st.floats()),
        (F64, st.floats()),
        (F32, st.floats(width=32)),
        (bytes, st.binary(max_size=40)),
        (Annotated[bytes, 5], st.binary(min_size=5, max_size=5)),
    ]
)


def tuples(items):
    fixed = st.lists(items, min_size=1, max_size=3).map(
        lambda each: (tuple[tuple(kind for kind, _ in each)], st.tuples(*(values for _, values in each)))
    )
    repeated = st.tuples(items, st.integers(0, 3)).map(
        lambda each: (Annotated[tuple[each[0][0], ...], each[1]], st.tuples(*[each[0][1]] * each[1]))
    )
    return fixed | repeated


def classes(items):
    return st.lists(items, max_size=3).map(_class)


def _class(fields):
    kind = make_dataclass("Drawn", [(f"f{n}", kind) for n, (kind, _) in enumerate(fields)], frozen=True)
    return kind, st.tuples(*(values for _, values in fields)).map(lambda values: kind(*values))


MEMORIES = classes(st.recursive(NUMBERS, lambda items: tuples(items) | classes(items), max_leaves=6))


@given(MEMORIES, st.data())
def test_a_memory_becomes_bytes_and_the_same_memory_again(memory, data):
    kind, values = memory
    value = data.draw(values)
    packing = Packing(kind)
    raw, settled = packing.settle(value)
    assert packing.size in (None, len(raw))
    assert repr(settled) == repr(value).replace("-nan", "nan"), "nothing was lost; repr tells NaNs and zeros apart"
    again = packing.decode(raw)
    assert repr(again) == repr(settled)
    assert packing.settle(again)[0] == packing.settle(settled)[0] == raw


@given(MEMORIES, st.data())
def test_any_other_bytes_are_refused_or_a_memory_of_just_these_bytes(memory, data):
    kind, values = memory
    packing = Packing(kind)
    raw, _ = packing.settle(data.draw(values))
    cut = raw[: data.draw(st.integers(0, len(raw)))]
    at = data.draw(st.integers(0, max(0, len(raw) - 1)))
    altered = raw[:at] + data.draw(st.binary(min_size=1, max_size=1)) + raw[at + 1 :]
    for other in (cut, altered, raw + b"\0", data.draw(st.binary(max_size=60))):
        try:
            value = packing.decode(other)
        except PeerError as error:
            assert error.reason == "malformed_record"
        else:
            assert packing.settle(value)[0] == other


@dataclass(frozen=True)
class Heard:
    id: U16 = 0
    x_m: F32 = 0.0
    far: bool = False


@dataclass(frozen=True)
class Memory:
    count: int = 0
    heard: tuple[Heard, Heard] = (Heard(), Heard())
    name: bytes = b""
    key: Annotated[bytes, 4] = bytes(4)


def changed(**fields):
    return dataclasses.replace(Memory(), **fields)


def test_the_layout_is_that_of_the_fields():
    raw, _ = Packing(Memory).settle(Memory(-1, (Heard(2, 0.5, far=True), Heard()), b"abc", b"wxyz"))
    assert raw == struct.pack("<q HfB HfB H3s 4s", -1, 2, 0.5, 1, 0, 0.0, 0, 3, b"abc", b"wxyz")


def test_a_record_of_the_byte_table_may_be_a_field():
    kind = make_dataclass("Last", [("state", State)], frozen=True)
    packing = Packing(kind)
    state = State(1.0, 2.0, 3.0, 4.0, id=7, t=9)
    raw, _ = packing.settle(kind(state))
    assert raw == state.encode()[1:], "all but the tag"
    assert packing.decode(raw) == kind(state)


def test_what_is_remembered_is_what_its_bytes_say():
    packing = Packing(Heard)
    _, settled = packing.settle(Heard(True, 0.1, 1))
    assert settled == Heard(1, struct.unpack("<f", struct.pack("<f", 0.1))[0], True)
    assert list(map(type, dataclasses.astuple(settled))) == [int, float, bool]
    assert packing.decode(packing.settle(settled)[0]) == settled
    _, settled = packing.settle(Heard(True, 1, 0))
    assert list(map(type, dataclasses.astuple(settled))) == [int, float, bool], "even where none of them is rounded"


@pytest.mark.parametrize("bits", [0x7FC00000, 0xFFC00000, 0x7FC00001, 0xFFFFFFFF])
def test_every_nan_has_the_same_bytes_and_no_others_are_read(bits):
    nan = struct.unpack("<f", struct.pack("<I", bits))[0]
    packing = Packing(Heard)
    raw, _ = packing.settle(Heard(1, nan))
    assert raw == packing.settle(Heard(1, math.nan))[0] == struct.pack("<HIB", 1, 0x7FC00000, 0)
    other = struct.pack("<HIB", 1, bits, 0)
    if other == raw:
        assert math.isnan(packing.decode(other).x_m)
    else:
        with pytest.raises(MalformedRecord):
            packing.decode(other)


@pytest.mark.parametrize("number", [math.inf, -math.inf, -0.0, 1e-45])
def test_other_odd_floats_are_kept_bit_by_bit(number):
    packing = Packing(Heard)
    raw, settled = packing.settle(Heard(1, number))
    assert raw[2:6] == struct.pack("<f", number)
    assert math.copysign(1.0, packing.decode(raw).x_m) == math.copysign(1.0, settled.x_m) == math.copysign(1.0, number)


@pytest.mark.parametrize(
    "value, complaint",
    [
        (changed(count=1 << 63), r"memory.count is 9223372036854775808: does not fit into I64"),
        (changed(count=0.5), r"memory.count is 0.5: does not fit into I64"),
        (changed(count=None), r"memory.count is None: does not fit into I64"),
        (changed(heard=(Heard(), Heard(-1))), r"memory.heard\[1\].id is -1: does not fit into U16"),
        (changed(heard=(Heard(x_m=1e39), Heard())), r"memory.heard\[0\].x_m is 1e\+39: does not fit into F32"),
        (changed(heard=(Heard(x_m="far"), Heard())), r"memory.heard\[0\].x_m is 'far': does not fit into F32"),
        (changed(heard=(Heard(),)), r"memory.heard is a tuple of 1, not a tuple of 2"),
        (changed(heard=[Heard(), Heard()]), r"memory.heard is a list, not a tuple of 2"),
        (changed(heard=(1, 2)), r"memory.heard\[0\] is a int, not a Heard"),
        (changed(key=b"abc"), r"memory.key has 3 bytes, not 4"),
        (changed(key=b"abcde"), r"memory.key has 5 bytes, not 4"),
        (changed(name="abc"), r"memory.name is a str, not at most 65535 bytes"),
        (changed(name=bytes(65_536)), r"memory.name has 65536 bytes, not at most 65535"),
        ((), r"memory is a tuple, not a Memory"),
    ],
)
def test_a_value_that_does_not_fit_is_named(value, complaint):
    with pytest.raises(Unfit, match=f"^{complaint}"):
        Packing(Memory).settle(value)


@dataclass
class Mutable:
    x: int = 0


@dataclass(frozen=True)
class Endless:
    next: Endless


@dataclass(frozen=True)
class Unknown:
    x: Nowhere  # noqa: F821


@pytest.mark.parametrize(
    "kind, complaint",
    [
        (list[int], r"memory.f is a list\[int\], which has no encoding"),
        (dict, r"memory.f is a dict"),
        (str, r"memory.f is a str"),
        (int | None, r"memory.f is a int \| None"),
        (Annotated[int, "u17"], r"memory.f is a Annotated\[int, 'u17'\]"),
        (Annotated[int, "f32"], r"memory.f is a Annotated\[int, 'f32'\]"),
        (Annotated[bytes, -1], r"memory.f is a Annotated\[bytes, -1\]"),
        (Annotated[bytes, 65_536], r"memory.f is a Annotated\[bytes, 65536\]"),
        (
            tuple[int, ...],
            r"memory.f is a tuple\[int, ...\] without a fixed length: use Annotated\[tuple\[int, ...\], 16\]",
        ),
        (Annotated[tuple[int, int], 2], r"memory.f is a tuple\[int, int\] annotated with 2"),
        (
            Annotated[tuple[Annotated[tuple[U8, ...], 300], ...], 300],
            r"memory.f\[218\]\[135\]: more than 65535 numbers",
        ),
        (tuple[str, int], r"memory.f\[0\] is a str"),
        (Mutable, r"memory.f is a Mutable that is not frozen: use @dataclass\(frozen=True\)"),
        (Endless, r"memory is a Drawn, which has itself among its fields"),
        (Unknown, r"memory.f: name 'Nowhere' is not defined"),
    ],
)
def test_a_field_without_bytes_is_named(kind, complaint):
    with pytest.raises(Unfit, match=f"^{complaint}"):
        Packing(make_dataclass("Drawn", [("f", kind)], frozen=True))


@pytest.mark.parametrize("kind", [int, tuple[int, int], dict])
def test_a_memory_is_a_dataclass(kind):
    with pytest.raises(Unfit, match="not a dataclass"):
        Packing(kind)


def test_what_a_dataclass_refuses_is_no_checkpoint():
    @dataclass(frozen=True)
    class Careful:
        share: float = 0.0

        def __post_init__(self):
            if not 0 <= self.share <= 1:
                raise KeyError(self.share)

    packing = Packing(Careful)
    assert packing.decode(struct.pack("<d", 0.5)) == Careful(0.5)
    with pytest.raises(MalformedRecord):
        packing.decode(struct.pack("<d", 1.5))
