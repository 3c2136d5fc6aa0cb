"""An operator's requests of a gateway on this machine."""

from __future__ import annotations

from phalanx.cli.gateway_of import ask_gateway


def ask(request: str, **words):
    """Return the answer to an operator's request about the link."""
    return ask_gateway(None, f"link/{request}", words)


def visitors() -> dict[str, dict]:
    """Return the visitors by name."""
    return {each["name"]: each for each in ask("visitors")["visitors"]}
