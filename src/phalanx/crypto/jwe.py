"""The only JWE form of the link: compact, `dir`, A256GCM (RFC 7516).

A general JOSE library obeys headers that the sender chose. Here the header is fixed and compared as bytes. Only this
file encodes or decodes base64url, and it accepts only canonical segments.
"""

from __future__ import annotations

import binascii

from cryptography.exceptions import InvalidTag

from phalanx.errors import MalformedJwe, NotAuthentic, TooLarge

from .keys import Key

IV_BYTES = 12
TAG_BYTES = 16
HEADER = b'{"alg":"dir","enc":"A256GCM"}'


# Characters outside base64url become "!", which is invalid in base64 too.
_TO_BASE64 = bytes.maketrans(b"-_+/=", b"+/!!!")
_TO_BASE64URL = bytes.maketrans(b"+/", b"-_")
_PADDING = (b"", b"===", b"==", b"=")


def encode_base64url(raw: bytes) -> bytes:
    """Return base64url without padding."""
    return binascii.b2a_base64(raw, newline=False).rstrip(b"=").translate(_TO_BASE64URL)


def decode_base64url(segment: bytes) -> bytes:
    """Return the bytes of canonical base64url without padding. Raises: MalformedJwe."""
    try:
        raw = binascii.a2b_base64(segment.translate(_TO_BASE64) + _PADDING[len(segment) % 4], strict_mode=True)
    except binascii.Error as error:
        raise MalformedJwe("a segment is not base64url") from error
    # The unused bits of the last character must be zero, so that a message has one text in every implementation.
    rest = len(raw) % 3
    if rest and encode_base64url(raw[-rest:]) != segment[-rest - 1 :]:
        raise MalformedJwe("a segment is not canonical base64url")
    return raw


HEADER_SEGMENT = encode_base64url(HEADER)


def seal_jwe(plaintext: bytes, key: Key, iv: bytes) -> bytes:
    """Return the compact JWE of `plaintext`; never use one 12-byte `iv` twice with a key.

    Source: RFC 7516 §5.1, §7.1.
    """
    sealed = key.cipher.encrypt(iv, plaintext, HEADER_SEGMENT)
    return b".".join((HEADER_SEGMENT, b"", *map(encode_base64url, (iv, sealed[:-TAG_BYTES], sealed[-TAG_BYTES:]))))


def open_jwe(token: bytes, key: Key, max_bytes: int) -> tuple[bytes, bytes]:
    """Return (IV, plaintext) of a compact JWE from untrusted bytes; above `max_bytes` it is rejected undecrypted.

    Raises: TooLarge, MalformedJwe, NotAuthentic. Source: RFC 7516 §5.2, restricted by docs/spec/link.md.
    """
    # A rough limit with slack for base64 rounding; the exact length of the ciphertext is checked below.
    if len(token) > (max_bytes + IV_BYTES + TAG_BYTES + len(HEADER)) * 4 // 3 + 16:
        raise TooLarge(f"{len(token)} bytes sealed, limit {max_bytes} bytes of plaintext")
    parts = token.split(b".", 5)
    if len(parts) != 5 or parts[0] != HEADER_SEGMENT or parts[1] != b"":
        raise MalformedJwe("not five segments, or not the expected header")
    iv, ciphertext, tag = (decode_base64url(part) for part in parts[2:])
    if len(iv) != IV_BYTES or len(tag) != TAG_BYTES:
        raise MalformedJwe("IV or tag of the wrong length")
    if len(ciphertext) > max_bytes:
        raise TooLarge(f"{len(ciphertext)} bytes of plaintext, limit {max_bytes}")
    try:
        return iv, key.cipher.decrypt(iv, ciphertext + tag, HEADER_SEGMENT)
    except InvalidTag as error:
        raise NotAuthentic("the tag does not verify") from error
