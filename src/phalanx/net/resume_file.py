"""The file in which a client keeps the secret to resume with."""

from __future__ import annotations

import json
import time
from pathlib import Path

from phalanx.crypto.jwe import decode_base64url, encode_base64url
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.link.envelope import decode_json
from phalanx.link.session import Invitation, Kind, Secret

from .private_file import write_private

LONGEST = 1024  # bytes
SECRET_BYTES = 32


def read_resume(path: Path, invitation: Invitation) -> Secret | None:
    """Return the secret with which to resume at this invitation's swarm; None: there is none that is valid now.

    Raises: UsageError: the file is none of ours; Unavailable: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(LONGEST + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}") from error
    try:
        kept = decode_json(raw)
        static, secret = (decode_base64url(kept[name].encode()) for name in ("static", "secret"))
        until_s = float(kept["until"])
    except (PeerError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise UsageError(f"{path} keeps no session", "another name; this file is left as it is") from error
    if static != invitation.static or len(secret) != SECRET_BYTES or until_s <= time.time():
        return None
    return Secret(Kind.RESUME, secret)


def write_resume(path: Path, invitation: Invitation, secret: Secret, lifetime_s: int) -> None:
    """Keep a secret, on disk when this returns. Raises: Unavailable."""
    kept = {
        "static": encode_base64url(invitation.static).decode(),
        "secret": encode_base64url(secret.raw).decode(),
        "until": int(time.time()) + lifetime_s,
    }
    write_private(path, json.dumps(kept).encode() + b"\n", replace=True)
