"""Keys: derived from a secret (HKDF) or a passphrase (scrypt), held so that printing is harmless, kept under a lock."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from dataclasses import dataclass, field

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from phalanx.errors import NotAuthentic, PeerError

FORM = "phalanx keys, version 1"
SALT_BYTES, NONCE_BYTES, KEY_BYTES = 16, 12, 32
LOG2_N, R = 17, 8  # 128 MiB, and some tenths of a second, for each guess
LIMIT = 1 << 20  # bytes of a sealed text


@dataclass(frozen=True, slots=True, repr=False, eq=False)  # not a bytes subclass: str() of one prints the bytes
class Key:
    """32 bytes of AES-256 key, and the cipher made of them once: making it costs as much as a short message."""

    raw: bytes
    cipher: AESGCM = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cipher", AESGCM(self.raw))

    def __repr__(self) -> str:
        return "<Key>"  # no fingerprint: a key derived from a short pin could be searched for


def hkdf_sha256(secret: bytes, info: bytes, length: int) -> bytes:
    """Return `length` bytes derived from `secret` for the purpose `info`, without salt. Source: RFC 5869."""
    return HKDF(algorithm=SHA256(), length=length, salt=None, info=info).derive(secret)


def scrypt(password: bytes, salt: bytes, *, log2_n: int, r: int, length: int) -> bytes:
    """Return `length` bytes derived from `password`, at a cost of 128 * r * 2^log2_n bytes of memory, passed twice.

    Source: RFC 7914, p = 1.
    """
    n = 1 << log2_n
    return hashlib.scrypt(password, salt=salt, n=n, r=r, p=1, maxmem=256 * r * n + (1 << 20), dklen=length)


class CorruptData(PeerError):
    """Not a sealed text, or not as it was written."""


@dataclass(frozen=True, slots=True, repr=False)
class Lock:
    """A salt and the key that a passphrase makes with it; to make one takes scrypt's time and memory."""

    salt: bytes
    key: bytes

    @classmethod
    def of(cls, passphrase: str, salt: bytes) -> Lock:
        """The key for this passphrase and salt (16 random bytes)."""
        return cls(salt, scrypt(passphrase.encode(), salt, log2_n=LOG2_N, r=R, length=KEY_BYTES))

    def __repr__(self) -> str:
        return "<Lock>"

    def seal(self, plain: bytes, nonce: bytes) -> str:
        """A text of plain letters, a checksum in it; `nonce` is 12 random bytes, never twice with one key."""
        sealed = AESGCM(self.key).encrypt(nonce, plain, FORM.encode() + self.salt)
        whole = self.salt + nonce + sealed
        told = {"form": FORM, "sealed": base64.b64encode(whole).decode(), "sha256": hashlib.sha256(whole).hexdigest()}
        return json.dumps(told, indent=1) + "\n"


def unlock(text: bytes, passphrase: str) -> tuple[Lock, bytes]:
    """Return the lock that a text was sealed with, and what it says; its form is checked before scrypt is run.

    Raises: CorruptData: it is none, or was changed. NotAuthentic: the passphrase is another.
    """
    whole = _whole(text)
    salt, rest = whole[:SALT_BYTES], whole[SALT_BYTES:]
    lock = Lock.of(passphrase, salt)
    try:
        return lock, AESGCM(lock.key).decrypt(rest[:NONCE_BYTES], rest[NONCE_BYTES:], FORM.encode() + salt)
    except InvalidTag as error:
        raise NotAuthentic("another passphrase") from error


def _whole(text: bytes) -> bytes:
    if len(text) > LIMIT:
        raise CorruptData(f"longer than {LIMIT} bytes")
    try:
        told = json.loads(text)
        whole = base64.b64decode(told["sealed"], validate=True)
        form, checksum = told["form"], told["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError, binascii.Error) as error:
        raise CorruptData("no file of keys") from error
    if form != FORM:
        raise CorruptData("no file of keys")
    if len(whole) < SALT_BYTES + NONCE_BYTES or checksum != hashlib.sha256(whole).hexdigest():
        raise CorruptData("its checksum is another")
    return whole
