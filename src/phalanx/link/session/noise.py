"""Noise_NKpsk0_25519_ChaChaPoly_SHA256: the handshake of a session, and the two ciphers that it derives.

Source: The Noise Protocol Framework, revision 34. Only this file uses X25519 and ChaCha20-Poly1305 in handshakes.
"""

from __future__ import annotations

import hmac
from hashlib import sha256
from typing import NamedTuple

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from phalanx.errors import NotAuthentic

NAME = b"Noise_NKpsk0_25519_ChaChaPoly_SHA256"
KEY_BYTES = HASH_BYTES = PUBLIC_BYTES = 32
_NONCE_ZEROS, _COUNTER_BYTES = bytes(4), 8
_EMPTY_BYTES = PUBLIC_BYTES + 16  # length of a message with an empty payload


class Cipher:
    """Cipher of one direction; the caller keeps the counter."""

    __slots__ = ("_aead", "_key")

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._aead = ChaCha20Poly1305(key)

    def seal(self, counter: int, plaintext: bytes, associated: bytes) -> bytes:
        """Encrypt; return ciphertext and tag. A counter must not be used twice."""
        return self._aead.encrypt(_nonce(counter), plaintext, associated)

    def open(self, counter: int, sealed: bytes, associated: bytes) -> bytes:
        """Decrypt; return the plaintext. Raises: NotAuthentic."""
        try:
            return self._aead.decrypt(_nonce(counter), sealed, associated)
        except InvalidTag as error:
            raise NotAuthentic("the tag does not verify") from error

    def derive(self, info: bytes, length: int) -> bytes:
        """Derive bytes from the key, for a purpose other than encryption."""
        return hmac.digest(self._key, info, "sha256")[:length]


class Keys(NamedTuple):
    """Ciphers of the two directions of a session, and the hash of its handshake."""

    to_server: Cipher
    to_client: Cipher
    handshake_hash: bytes


class _State(NamedTuple):
    """SymmetricState of Noise; immutable, so that a forged message changes nothing."""

    hash: bytes
    chaining: bytes
    key: bytes

    def mix_hash(self, data: bytes) -> _State:
        return self._replace(hash=sha256(self.hash + data).digest())

    def mix_key(self, material: bytes) -> _State:
        chaining, key, _ = _hkdf(self.chaining, material)
        return self._replace(chaining=chaining, key=key)

    def mix_psk(self, psk: bytes) -> _State:
        chaining, extra, key = _hkdf(self.chaining, psk)
        return self._replace(chaining=chaining, key=key).mix_hash(extra)

    def mix_ephemeral(self, public: bytes) -> _State:
        return self.mix_hash(public).mix_key(public)  # mix_key because of the psk: Noise §9.2

    def seal(self, payload: bytes) -> tuple[_State, bytes]:
        sealed = Cipher(self.key).seal(0, payload, self.hash)
        return self.mix_hash(sealed), sealed

    def open(self, sealed: bytes) -> tuple[_State, bytes]:
        payload = Cipher(self.key).open(0, sealed, self.hash)
        return self.mix_hash(sealed), payload

    def split(self) -> Keys:
        first, second, _ = _hkdf(self.chaining, b"")
        return Keys(Cipher(first), Cipher(second), self.hash)


class Initiator:
    """Client's side of a handshake, with the server's static public key and the psk.

    Args:
        ephemeral: 32 fresh random bytes, never used twice.
    """

    __slots__ = ("_ephemeral", "_state", "_static")

    def __init__(self, prologue: bytes, static: bytes, psk: bytes, ephemeral: bytes) -> None:
        self._ephemeral = X25519PrivateKey.from_private_bytes(ephemeral)
        self._static = static
        self._state = _begin(prologue, static).mix_psk(psk)

    def write(self, payload: bytes = b"") -> bytes:
        """Return the first message. Raises: NotAuthentic: the server's static key is a point of low order."""
        public = self._ephemeral.public_key().public_bytes_raw()
        state = self._state.mix_ephemeral(public).mix_key(_exchange(self._ephemeral, self._static))
        self._state, sealed = state.seal(payload)
        return public + sealed

    def read(self, message: bytes) -> tuple[bytes, Keys]:
        """Return the payload of the second message, and the keys; a refused message leaves the state unchanged.

        Raises: NotAuthentic.
        """
        theirs, sealed = _split(message)
        state = self._state.mix_ephemeral(theirs).mix_key(_exchange(self._ephemeral, theirs))
        state, payload = state.open(sealed)
        return payload, state.split()


def respond(
    prologue: bytes, static: X25519PrivateKey, psk: bytes, ephemeral: bytes, message: bytes, payload: bytes = b""
) -> tuple[bytes, bytes, Keys]:
    """Answer a first message: the server's side of a handshake.

    Args:
        ephemeral: 32 fresh random bytes, never used twice.
    Returns: the first message's payload, the second message, the keys.
    Raises: NotAuthentic.
    """
    state = _begin(prologue, static.public_key().public_bytes_raw()).mix_psk(psk)
    theirs, sealed = _split(message)
    state = state.mix_ephemeral(theirs).mix_key(_exchange(static, theirs))
    state, received = state.open(sealed)
    own = X25519PrivateKey.from_private_bytes(ephemeral)
    public = own.public_key().public_bytes_raw()
    state, answer = state.mix_ephemeral(public).mix_key(_exchange(own, theirs)).seal(payload)
    return received, public + answer, state.split()


def _begin(prologue: bytes, static: bytes) -> _State:
    name = sha256(NAME).digest()  # hashed because the name is longer than a hash
    return _State(name, name, b"").mix_hash(prologue).mix_hash(static)


def _hkdf(chaining: bytes, material: bytes) -> tuple[bytes, bytes, bytes]:
    temporary = hmac.digest(chaining, material, "sha256")
    first = hmac.digest(temporary, _ONE, "sha256")
    second = hmac.digest(temporary, first + _TWO, "sha256")
    return first, second, hmac.digest(temporary, second + _THREE, "sha256")


_ONE, _TWO, _THREE = (bytes([number]) for number in (1, 2, 3))


def _nonce(counter: int) -> bytes:
    return _NONCE_ZEROS + counter.to_bytes(_COUNTER_BYTES, "little")


def _split(message: bytes) -> tuple[bytes, bytes]:
    if len(message) < _EMPTY_BYTES:
        raise NotAuthentic(f"a handshake message of {len(message)} bytes")
    return message[:PUBLIC_BYTES], message[PUBLIC_BYTES:]


def _exchange(own: X25519PrivateKey, theirs: bytes) -> bytes:
    try:
        return own.exchange(X25519PublicKey.from_public_bytes(theirs))
    except ValueError as error:  # low order: the shared secret would be zero for any private key
        raise NotAuthentic("the public key is of low order") from error
