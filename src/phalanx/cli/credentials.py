"""Read the operator's secrets from files, the terminal or the environment.

Only the package cli reads the environment. Signing keys are PEM files of OpenSSL or `phalanx keys export`.
"""

from __future__ import annotations

import os
import re
import secrets
import ssl
import sys
from pathlib import Path

import click
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

from phalanx.config.written import file_meant, read_at_most
from phalanx.errors import UsageError
from phalanx.net import Login
from phalanx.net.private_file import check_private

SHORTEST = 12  # characters of a new passphrase
KEY_HINT = "create a key: openssl genpkey -algorithm ed25519 -out operator.pem"
MOST_BYTES = 1 << 16


def read_login(path: Path | None) -> Login | None:
    """Return the broker's login from a file or, without one, from the environment.

    Raises: UsageError: the file has no user:password, or SSL_CERT_FILE, the trusted authorities, has no certificates.
    """
    _check_authorities()
    username = os.environ.get("PHALANX_BROKER_USERNAME", "")
    if path is not None or not username:
        return login_in(path)
    return Login(username, os.environ.get("PHALANX_BROKER_PASSWORD", ""))


def _check_authorities() -> None:
    # OpenSSL ignores a missing file without an error, and then trusts no server.
    if file := os.environ.get("SSL_CERT_FILE"):
        try:
            ssl.create_default_context(cafile=file)
        except OSError as error:
            reason = "no certificate in it" if isinstance(error, ssl.SSLError) else error.strerror
            hint = _hint_of(error, Path(file), "use a PEM file with the certificate of your authority")
            raise UsageError(f"SSL_CERT_FILE is {file}: {reason}", hint) from error


def login_for(broker: str, path: Path | None) -> Login | None:
    """Return the login for a broker. Raises: UsageError: as `read_login`, or a login for a broker that we start."""
    from phalanx.net.broker import is_ours  # noqa: PLC0415 - missions need no broker

    if is_ours(broker) and path is not None:
        raise UsageError("--broker-login with --broker mosquitto", "use it with a --broker URL only")
    return read_login(path)


def login_in(path: Path | None) -> Login | None:
    """Return the login in a file, or None without a file. Raises: UsageError: as `read_login`."""
    if path is None:
        return None
    username, colon, password = first_line(path, "use a file with one line: user:password").partition(":")
    if not (username and colon):
        raise UsageError(f"{path} does not hold user:password", "write one line: user:password")
    return Login(username, password)


def first_line(path: Path, hint: str) -> str:
    """Return the first line of a secret's file, or "". Raises: UsageError with `hint`: the file is unreadable."""
    try:
        # utf-8-sig: editors of Windows write a byte order mark. The read is limited, as `path` may be a device.
        with path.open(encoding="utf-8-sig") as file:
            lines = file.read(4096).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise UsageError(f"cannot read {path}: {reason}", _hint_of(error, path, hint)) from error
    return lines[0] if lines else ""


def _hint_of(error: Exception, path: Path, hint: str) -> str:
    return file_meant(path, hint) if isinstance(error, FileNotFoundError) else hint


def kept_token(path: Path) -> str:
    """Return the operator's token in a file, which is created if missing. Raises: UsageError: the file is unusable."""
    try:
        # Opened once and without following links: between a check and a second open the file could be replaced.
        with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600), "r+") as file:
            check_private(path, os.fstat(file.fileno()))
            token = file.read(256).strip()
            if not token:
                token = secrets.token_hex(16)
                file.write(token + "\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise UsageError(f"cannot store a token in {path}: {reason}", "use a file that you own") from error
    if not re.fullmatch(r"[0-9A-Za-z_.~-]{16,255}", token):
        raise UsageError(f"no token in {path}", "write 16 or more letters and digits, or empty the file for a new one")
    return token


def passphrase_of(keys: Path, file: Path | None) -> str:
    """Return the passphrase of an existing key file. Raises: UsageError: as `passphrase`, or `keys` is missing."""
    from phalanx.net.keyring import read_sealed  # noqa: PLC0415 - logins need no numpy

    read_sealed(keys)
    return passphrase(file)


def passphrase(file: Path | None, *, new: bool = False) -> str:
    """Return a key file's passphrase, from `file` or a prompt. Raises: UsageError: none, or too short."""
    if file is not None:
        secret = first_line(file, "use a file whose first line is the passphrase")
    elif sys.stdin.isatty():
        what = "New passphrase" if new else "Passphrase"
        secret = click.prompt(what, hide_input=True, confirmation_prompt=new, err=True, default="", show_default=False)
    else:
        raise UsageError("no terminal to prompt for the passphrase", "use --passphrase-file FILE")
    if not secret or (new and len(secret) < SHORTEST):
        raise UsageError(f"passphrase of {len(secret)} characters", f"use {SHORTEST} or more: several random words")
    return str(secret)


def read_signing_key(path: Path) -> Ed25519PrivateKey:
    """Return the Ed25519 private key in a PEM file. Raises: UsageError."""
    try:
        key = load_pem_private_key(read_at_most(path, MOST_BYTES, KEY_HINT), None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise UsageError(f"no unencrypted private key in {path}", KEY_HINT) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise UsageError(f"{path} is not an Ed25519 key", KEY_HINT)
    return key


def read_trusted(text: str) -> bytes:
    """Return a public key, given as 64 hex digits or as a PEM file. Raises: UsageError."""
    if re.fullmatch(r"[0-9a-fA-F]{64}", text):
        return bytes.fromhex(text)
    hint = "use 64 hex digits, or the file that openssl pkey -in operator.pem -pubout writes"
    try:
        key = load_pem_public_key(read_at_most(Path(text), MOST_BYTES, hint))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UsageError(f"no public key in {text}", hint) from error
    if not isinstance(key, Ed25519PublicKey):
        raise UsageError(f"{text} is not an Ed25519 key", hint)
    return key.public_bytes_raw()
