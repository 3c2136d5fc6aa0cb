"""Pages served in this process, without a gateway."""

from __future__ import annotations

from types import SimpleNamespace

from phalanx.gateway.payloads import check_words
from phalanx.gateway.serve_pages import PAGE_POLICY, PAGES, OperatorPages
from phalanx.net.ports import listen
from phalanx.net.site import Site


def a_page(port: int = 0, host: str = "127.0.0.1", connections: int = 1000) -> Site:
    """The visitors' page, served in this process."""
    return Site(PAGES / "visitor", PAGE_POLICY, connections=connections, doors=[listen(host, port, "--port")])


def operator_pages(token: str, state=dict, port: int = 0, **said) -> OperatorPages:
    """The operator's page of a gateway that does nothing but what is `said`."""

    async def ask(what, words):
        return state() if what == "state" else check_words(words)

    desk = SimpleNamespace(ask=ask)
    running = SimpleNamespace(hold=said.get("hold", lambda _: None), desk=desk, health=said.get("health"))
    return OperatorPages(token, running, port)
