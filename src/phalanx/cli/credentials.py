"""Read the operator's secrets from files, the terminal or the environment, which only this package reads.

Signing keys are PEM, of OpenSSL or `phalanx keys export`.
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

SHORTEST = 12  # letters of a passphrase
KEY_HINT = "openssl genpkey -algorithm ed25519 -out operator.pem makes one"
MOST_BYTES = 1 << 16


def read_login(path: Path | None) -> Login | None:
    """Return the broker's login from a file, which is never repeated, or the environment.

    Raises: UsageError: the file holds no user:password, or SSL_CERT_FILE, by which brokers are known, no certificates.
    """
    _check_authorities()
    username = os.environ.get("PHALANX_BROKER_USERNAME", "")
    if path is not None or not username:
        return login_in(path)
    return Login(username, os.environ.get("PHALANX_BROKER_PASSWORD", ""))


def _check_authorities() -> None:
    # OpenSSL says nothing of a file that is not there, and then trusts nobody.
    if file := os.environ.get("SSL_CERT_FILE"):
        try:
            ssl.create_default_context(cafile=file)
        except OSError as error:
            reason = "no certificate in it" if isinstance(error, ssl.SSLError) else error.strerror
            hint = _hint_of(error, Path(file), "the file of an authority of your own, PEM")
            raise UsageError(f"SSL_CERT_FILE is {file}: {reason}", hint) from error


def login_for(broker: str, path: Path | None) -> Login | None:
    """The same, for a broker by this name or URL. Raises: UsageError: as `read_login`, or a file for one of our own."""
    from phalanx.net.broker import is_ours  # noqa: PLC0415 - missions need no broker

    if is_ours(broker) and path is not None:
        raise UsageError("a login for a broker of our own", "give it with a --broker URL only")
    return read_login(path)


def login_in(path: Path | None) -> Login | None:
    """Return the login in a file, if one is given. Raises: UsageError: as `read_login`."""
    if path is None:
        return None
    username, colon, password = first_line(path, "a file with one line user:password").partition(":")
    if not (username and colon):
        raise UsageError(f"{path} does not hold user:password", "one line, the name first")
    return Login(username, password)


def first_line(path: Path, hint: str) -> str:
    """Return the first line of a secret's file, or "". Raises: UsageError: it is unreadable; `hint` says what it is."""
    try:
        # Editors of Windows begin with a mark. And not more of it than a secret has: it may be a device.
        with path.open(encoding="utf-8-sig") as file:
            lines = file.read(4096).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise UsageError(f"cannot read {path}: {reason}", _hint_of(error, path, hint)) from error
    return lines[0] if lines else ""


def _hint_of(error: Exception, path: Path, hint: str) -> str:
    return file_meant(path, hint) if isinstance(error, FileNotFoundError) else hint


def kept_token(path: Path) -> str:
    """Return the operator's token in a file, which is made if it is not there. Raises: UsageError: it is not ours."""
    try:
        # Opened once, and never followed elsewhere: between a look and a second opening somebody could swap it.
        with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600), "r+") as file:
            check_private(path, os.fstat(file.fileno()))
            token = file.read(256).strip()
            if not token:
                token = secrets.token_hex(16)
                file.write(token + "\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise UsageError(f"cannot keep a token in {path}: {reason}", "a file that is yours") from error
    if not re.fullmatch(r"[0-9A-Za-z_.~-]{16,255}", token):
        raise UsageError(f"{path} holds no token", "16 or more letters and digits; an empty file gets one")
    return token


def passphrase_of(keys: Path, file: Path | None) -> str:
    """As `passphrase`; nobody is asked for that of a file that is not there. Raises: UsageError: it is not, too."""
    from phalanx.net.keyring import read_sealed  # noqa: PLC0415 - logins need no numpy

    read_sealed(keys)
    return passphrase(file)


def passphrase(file: Path | None, *, new: bool = False) -> str:
    """That of a file of keys, from a file's first line or asked for. Raises: UsageError: none, or too short."""
    if file is not None:
        said = first_line(file, "a file whose first line is the passphrase")
    elif sys.stdin.isatty():
        what = "New passphrase" if new else "Passphrase"
        said = click.prompt(what, hide_input=True, confirmation_prompt=new, err=True, default="", show_default=False)
    else:
        raise UsageError("nobody is there to say a passphrase", "--passphrase-file FILE")
    if not said or (new and len(said) < SHORTEST):
        raise UsageError(f"a passphrase of {len(said)} letters", f"{SHORTEST} or more: some words that nobody guesses")
    return str(said)


def read_signing_key(path: Path) -> Ed25519PrivateKey:
    """Return an operator's key. Raises: UsageError."""
    try:
        key = load_pem_private_key(read_at_most(path, MOST_BYTES, KEY_HINT), None)
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
        key = load_pem_public_key(read_at_most(Path(said), MOST_BYTES, hint))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UsageError(f"{said} holds no public key", hint) from error
    if not isinstance(key, Ed25519PublicKey):
        raise UsageError(f"{said} is not an Ed25519 key", hint)
    return key.public_bytes_raw()
