"""What the operator's page asks of a gateway on this machine."""

from __future__ import annotations

import json
import urllib.error
import urllib.request


def asked(ready: dict, what: str, words: object = (), token: str | None = None, **headers: str) -> tuple[int, dict]:
    """Return status and answer of a request with the gateway's own token, or with another."""
    page, own = ready["operator_url"].split("#token=")
    with_token = {"Authorization": f"Bearer {own if token is None else token}"} | headers
    request = urllib.request.Request(
        f"{page}api/link/{what}", json.dumps({} if words == () else words).encode(), with_token
    )
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def state_of(ready: dict) -> dict:
    return asked(ready, "state")[1]
