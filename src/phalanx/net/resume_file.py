"""File in which a client stores its resume secret."""

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
    """Return the stored resume secret for this invitation's swarm; None if there is none, or it has expired.

    Raises: UsageError: the file is no such file; Unavailable: it cannot be read.
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
        raise UsageError(f"{path} is no session file", "use another name: this file is not overwritten") from error
    if static != invitation.static or len(secret) != SECRET_BYTES or until_s <= time.time():
        return None
    return Secret(Kind.RESUME, secret)


def write_resume(path: Path, invitation: Invitation, secret: Secret, lifetime_s: int) -> None:
    """Store a secret durably. Raises: Unavailable: it cannot be written."""
    kept = {
        "static": encode_base64url(invitation.static).decode(),
        "secret": encode_base64url(secret.raw).decode(),
        "until": int(time.time()) + lifetime_s,
    }
    write_private(path, json.dumps(kept).encode() + b"\n", replace=True)
