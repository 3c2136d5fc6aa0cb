"""Read the files of signing keys: PEM, of OpenSSL or `phalanx keys export`."""

from __future__ import annotations

import re
from pathlib import Path

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

from phalanx.config.written import read_at_most
from phalanx.errors import UsageError

KEY_HINT = "openssl genpkey -algorithm ed25519 -out operator.pem makes one"


def read_signing_key(path: Path) -> Ed25519PrivateKey:
    """Return an operator's key. Raises: UsageError."""
    try:
        key = load_pem_private_key(read_at_most(path, 1 << 16, KEY_HINT), None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise UsageError(f"{path} holds no private key without a password", KEY_HINT) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise UsageError(f"{path} is not an Ed25519 key", KEY_HINT)
    return key


def read_trusted(said: str) -> bytes:
    """Return a public key, from 64 hex digits, or the PEM file of it. Raises: UsageError."""
    if re.fullmatch(r"[0-9a-fA-F]{64}", said):
        return bytes.fromhex(said)
    hint = "64 hex digits, or the file that openssl pkey -in operator.pem -pubout writes"
    try:
        key = load_pem_public_key(read_at_most(Path(said), 1 << 16, hint))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UsageError(f"{said} holds no public key", hint) from error
    if not isinstance(key, Ed25519PublicKey):
        raise UsageError(f"{said} is not an Ed25519 key", hint)
    return key.public_bytes_raw()
