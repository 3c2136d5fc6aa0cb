"""Keys: derivation from a secret (HKDF) or a passphrase (scrypt), a type that hides them, encrypted key files."""

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
LOG2_N, R = 17, 8  # each guess of a passphrase costs 128 MiB and some tenths of a second
LIMIT = 1 << 20  # bytes of a key file


@dataclass(frozen=True, slots=True, repr=False, eq=False)  # not a bytes subclass: str() of one prints the bytes
class Key:
    """A 32-byte AES-256 key with its cipher, made once: to make it costs as much as to encrypt a short message."""

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
    """Return `length` bytes derived from `password`; each call takes 128 * r * 2^log2_n bytes of memory.

    Source: RFC 7914, p = 1.
    """
    n = 1 << log2_n
    return hashlib.scrypt(password, salt=salt, n=n, r=r, p=1, maxmem=256 * r * n + (1 << 20), dklen=length)


class CorruptData(PeerError):
    """The bytes are not a key file, or were changed."""


@dataclass(frozen=True, slots=True, repr=False)
class Lock:
    """A salt, and the key derived from it and a passphrase with scrypt, which is slow on purpose."""

    salt: bytes
    key: bytes

    @classmethod
    def of(cls, passphrase: str, salt: bytes) -> Lock:
        """Return the lock for a passphrase and a salt of 16 random bytes."""
        return cls(salt, scrypt(passphrase.encode(), salt, log2_n=LOG2_N, r=R, length=KEY_BYTES))

    def __repr__(self) -> str:
        return "<Lock>"

    def seal(self, plain: bytes, nonce: bytes) -> str:
        """Return an ASCII key file with `plain` encrypted, and a checksum; `nonce` is 12 random bytes, never reused."""
        sealed = AESGCM(self.key).encrypt(nonce, plain, FORM.encode() + self.salt)
        whole = self.salt + nonce + sealed
        fields = {"form": FORM, "sealed": base64.b64encode(whole).decode(), "sha256": hashlib.sha256(whole).hexdigest()}
        return json.dumps(fields, indent=1) + "\n"


def unlock(text: bytes, passphrase: str) -> tuple[Lock, bytes]:
    """Return the lock and the decrypted bytes of a key file; its form is checked before the slow scrypt.

    Raises: CorruptData: not a key file, or changed. NotAuthentic: the passphrase is wrong.
    """
    whole = _whole(text)
    salt, rest = whole[:SALT_BYTES], whole[SALT_BYTES:]
    lock = Lock.of(passphrase, salt)
    try:
        return lock, AESGCM(lock.key).decrypt(rest[:NONCE_BYTES], rest[NONCE_BYTES:], FORM.encode() + salt)
    except InvalidTag as error:
        raise NotAuthentic("wrong passphrase") from error


def _whole(text: bytes) -> bytes:
    """Return salt, nonce and ciphertext of a key file, its checksum verified."""
    if len(text) > LIMIT:
        raise CorruptData(f"longer than {LIMIT} bytes")
    try:
        content = json.loads(text)
        whole = base64.b64decode(content["sealed"], validate=True)
        form, checksum = content["form"], content["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError, binascii.Error) as error:
        raise CorruptData("not a key file") from error
    if form != FORM:
        raise CorruptData("not a key file")
    if len(whole) < SALT_BYTES + NONCE_BYTES or checksum != hashlib.sha256(whole).hexdigest():
        raise CorruptData("the checksum does not match")
    return whole
