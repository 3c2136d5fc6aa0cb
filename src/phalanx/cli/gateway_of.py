"""Find this user's running gateway by its state folder, and send it requests as the operator's page does."""

from __future__ import annotations

import json
import os
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable, UsageError

TIMEOUT_S = 10.0
REFUSED = 409  # no such robot, or the visitor may not drive it


def default_state() -> Path:
    """Return the default state folder: that of the systemd service, or one below this user's home."""
    service = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]  # set by systemd
    base = os.environ.get("XDG_STATE_HOME", "")
    below = Path(base) if base.startswith("/") else Path.home() / ".local" / "state"
    return Path(service) / "sessions" if service else below / "phalanx"


def ask_gateway(state: Path | None, what: str, request_body: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of a running gateway.

    Raises: Unavailable: none runs, no answer, or the request is refused; UsageError: the request is invalid.
    """
    from phalanx.gateway.state_folder import operator_url_in  # noqa: PLC0415 - slow to import

    page, _, token = operator_url_in(state or default_state()).partition("#token=")
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    url, body = f"{page}api/{what}", json.dumps(request_body).encode()
    request = urllib.request.Request(url, body, headers)  # noqa: S310 - http, from our own file
    try:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=TIMEOUT_S) as answer:
            reply: dict[str, Any] = json.load(answer)
            return reply
    except urllib.error.HTTPError as error:
        refusal = json.loads(error.read() or b"{}")
        kind = Unavailable if error.code == REFUSED else UsageError
        raise kind(refusal.get("error", str(error)), refusal.get("hint", "")) from error
    except (OSError, ValueError) as error:
        raise Unavailable("the gateway does not answer", "check that phalanx up is still running") from error
