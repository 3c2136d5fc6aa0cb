"""Find the gateway of this user that runs with a folder, and ask it as its operator's page does."""

from __future__ import annotations

import json
import os
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable, UsageError

TIMEOUT_S = 10.0
REFUSED = 409  # no such robot, or one that this visitor may not have


def default_state() -> Path:
    """Return the folder of a gateway that was given none: a service's own, or one below this user's home."""
    service = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]  # set by systemd
    base = os.environ.get("XDG_STATE_HOME", "")
    below = Path(base) if base.startswith("/") else Path.home() / ".local" / "state"
    return Path(service) / "sessions" if service else below / "phalanx"


def ask_gateway(state: Path | None, what: str, words: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of a running gateway.

    Raises: Unavailable: none runs, it does not answer, or it refuses; UsageError: it cannot be asked that.
    """
    from phalanx.gateway.state_folder import operator_url_in  # noqa: PLC0415 - as much to import as all the rest

    page, _, token = operator_url_in(state or default_state()).partition("#token=")
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    url, body = f"{page}api/{what}", json.dumps(words).encode()
    request = urllib.request.Request(url, body, headers)  # noqa: S310 - http, of a file of ours
    try:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=TIMEOUT_S) as answer:
            told: dict[str, Any] = json.load(answer)
            return told
    except urllib.error.HTTPError as error:
        said = json.loads(error.read() or b"{}")
        kind = Unavailable if error.code == REFUSED else UsageError
        raise kind(said.get("error", str(error)), said.get("hint", "")) from error
    except (OSError, ValueError) as error:
        raise Unavailable("the gateway does not answer", "is phalanx up still running?") from error
