"""The client's end of a websocket reads what a broker says, and refuses what nobody agreed on."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.errors import PeerError
from phalanx.io.websocket import Websocket, frame_head


def frame(payload: bytes, opcode: int = 2) -> bytes:
    return frame_head(opcode, len(payload)) + payload


@given(st.lists(st.binary(max_size=300), max_size=8), st.lists(st.integers(1, 90), min_size=1, max_size=9))
def test_what_one_end_says_the_other_reads_however_it_is_cut(payloads, cuts):
    said = b"".join(frame(each) + frame(b"hm", 9) + frame(b"", 0) + frame(b"", 10) for each in payloads)
    there, out, at, turn = Websocket(), b"", 0, 0
    while at < len(said) or there.has_more:
        out += there.read(said[at : at + cuts[turn % len(cuts)]])
        at += cuts[turn % len(cuts)]
        turn += 1
    assert out == b"".join(payloads)
    assert there.replies == (b"\x8a\x82" + bytes(4) + b"hm" if payloads else b""), "to the last of them"


def test_a_long_frame_is_one():
    there = Websocket()
    assert there.read(frame(bytes(70_000))) == bytes(70_000)


def test_others_wait_for_so_many_frames_and_no_more():
    there = Websocket()
    assert there.read(frame(b"x") * 20) == b"x" * 16
    assert there.has_more
    assert there.read() == b"x" * 4
    assert not there.has_more


def test_what_was_said_before_the_end_is_heard_and_the_end_is_answered():
    there = Websocket()
    assert there.read(frame(b"last words") + frame(b"\x03\xe8", 8) + frame(b"rest")) == b"last words"
    assert there.closed
    assert there.replies == b"\x88\x80" + bytes(4)
    assert not there.has_more


@pytest.mark.parametrize(
    "stream",
    [
        b"\x82\x83\x00\x00\x00\x00abc",  # masked, as clients do
        frame(b"text", 1),
        b"\xc2" + frame(b"compressed")[1:],
        frame(b"x" * 126, 9),
    ],
)
def test_nothing_else_is_taken(stream):
    with pytest.raises(PeerError):
        Websocket().read(stream)


@given(st.binary(max_size=300))
def test_rubbish_is_refused_or_ignored(data):
    with contextlib.suppress(PeerError):
        Websocket().read(data)
