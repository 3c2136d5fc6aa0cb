"""The handshake of sessions is Noise's: the published vectors, and what a forged message does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.errors import NotAuthentic
from phalanx.link.session.noise import Initiator, respond

VECTORS = json.loads((Path(__file__).parent.parent / "vectors" / "noise.json").read_text())["cases"]
STATIC = X25519PrivateKey.from_private_bytes(bytes(range(32)))
PUBLIC = STATIC.public_key().public_bytes_raw()


def begun(psk: bytes = b"k" * 32, prologue: bytes = b"p") -> Initiator:
    return Initiator(prologue, PUBLIC, psk, b"e" * 32)


def answered(message: bytes, psk: bytes = b"k" * 32, prologue: bytes = b"p"):
    return respond(prologue, STATIC, psk, b"f" * 32, message)


@pytest.mark.parametrize("case", VECTORS, ids=lambda case: case["name"])
def test_the_published_vectors_hold(case):
    def of(name: str) -> bytes:
        return bytes.fromhex(case[name])

    psk = bytes.fromhex(case["init_psks"][0])
    initiator = Initiator(of("init_prologue"), of("init_remote_static"), psk, of("init_ephemeral"))
    payloads = [bytes.fromhex(each["payload"]) for each in case["messages"]]
    sealed = [bytes.fromhex(each["ciphertext"]) for each in case["messages"]]
    assert initiator.write(payloads[0]) == sealed[0]
    static = X25519PrivateKey.from_private_bytes(of("resp_static"))
    got, answer, server = respond(of("resp_prologue"), static, psk, of("resp_ephemeral"), sealed[0], payloads[1])
    assert (got, answer) == (payloads[0], sealed[1])
    got, client = initiator.read(sealed[1])
    assert got == payloads[1]
    assert client.handshake_hash == server.handshake_hash == of("handshake_hash")
    for n, (payload, ciphertext) in enumerate(zip(payloads[2:], sealed[2:], strict=True)):
        end, other = (client, server) if n % 2 == 0 else (server, client)
        names = ("to_server", "to_client") if n % 2 == 0 else ("to_client", "to_server")
        assert getattr(end, names[0]).seal(n // 2, payload, b"") == ciphertext
        assert getattr(other, names[0]).open(n // 2, ciphertext, b"") == payload
        with pytest.raises(NotAuthentic):
            getattr(other, names[1]).open(n // 2, ciphertext, b"")


def test_a_forged_answer_leaves_the_handshake_as_it_was():
    initiator = begun()
    _, answer, server = answered(initiator.write())
    for forged in (b"", answer[:-1], bytes(48), answer[:32] + bytes(16), b"\x01" + answer[1:]):
        with pytest.raises(NotAuthentic):
            initiator.read(forged)
    _, client = initiator.read(answer)
    assert client.handshake_hash == server.handshake_hash


@pytest.mark.parametrize("low", [bytes(32), b"\x01" + bytes(31), b"\xec" + b"\xff" * 30 + b"\x7f"])
def test_public_keys_of_low_order_are_refused(low):
    with pytest.raises(NotAuthentic):
        answered(low + bytes(16))
    initiator = begun()
    initiator.write()
    with pytest.raises(NotAuthentic):
        initiator.read(low + bytes(16))
    with pytest.raises(NotAuthentic):
        Initiator(b"p", low, b"k" * 32, b"e" * 32).write()


@pytest.mark.parametrize("other", [{"psk": b"K" * 32}, {"prologue": b"P"}])
def test_another_psk_or_prologue_is_refused(other):
    with pytest.raises(NotAuthentic):
        answered(begun().write(), **other)


@settings(deadline=None, max_examples=50)
@given(st.binary(max_size=120))
def test_garbage_is_not_authentic(raw):
    with pytest.raises(NotAuthentic):
        answered(raw)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 48 * 8 - 1))
def test_a_bit_that_was_altered_is_found(bit):
    message = bytearray(begun().write())
    message[bit // 8] ^= 1 << bit % 8
    with pytest.raises(NotAuthentic):
        answered(bytes(message))
