"""URLs of MQTT brokers; the login is kept apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from urllib.parse import urlsplit

from phalanx.errors import UsageError, did_you_mean
from phalanx.link.qrurl import Login

PORTS = {"mqtt": 1883, "mqtts": 8883, "ws": 80, "wss": 443}
EXAMPLE = "use a URL such as mqtt://localhost:1883"


@dataclass(frozen=True, slots=True)
class BrokerUrl:
    """Address of a broker, and the login for it."""

    scheme: str  # mqtt, mqtts, ws or wss
    host: str  # name or address, IPv6 without brackets
    port: int
    path: str = ""  # path of the websocket; "" for TCP
    login: Login | None = None  # None: anonymous

    @property
    def tls(self) -> bool:
        """Return whether the connection uses TLS; payloads are always encrypted."""
        return self.scheme in ("mqtts", "wss")

    @property
    def websockets(self) -> bool:
        """Return whether it is a websocket, which browsers can use."""
        return self.scheme in ("ws", "wss")

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}{self.path}"


def parse_broker_url(url: str, login: Login | None = None) -> BrokerUrl:
    """Parse an mqtt://, mqtts://, ws:// or wss:// URL. Raises: UsageError: another URL, or one with a login."""
    try:
        parts = urlsplit(url if "://" in url else f"mqtt://{url}")
        port = parts.port
    except ValueError as error:
        raise UsageError("the broker's URL has a bad host or port", EXAMPLE) from error
    scheme = parts.scheme.lower()
    if scheme not in PORTS:
        near = did_you_mean(f"{scheme}://", [f"{each}://" for each in PORTS])
        raise UsageError(f"unknown broker scheme {scheme}://", f"{near}use mqtt://, mqtts://, ws:// or wss://")
    if parts.username or parts.password:
        raise UsageError(
            "the broker's URL contains a login, which every user of this machine could read",
            "put it into PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD, or into a file for --broker-login",
        )
    if not parts.hostname or parts.query or parts.fragment or port == 0:
        raise UsageError("the broker's URL has no host, port 0, a query or a fragment", EXAMPLE)
    websockets = scheme in ("ws", "wss")
    if not websockets and parts.path not in ("", "/"):
        raise UsageError(f"a {scheme}:// URL of a broker has no path", "use a path only with ws:// or wss://")
    path = (parts.path if parts.path not in ("", "/") else "/mqtt") if websockets else ""
    return BrokerUrl(scheme, parts.hostname, port or PORTS[scheme], path, login)


def websocket_of(broker: BrokerUrl) -> str:
    """Return its URL for browsers: for mqtt:// the next port (1883, 1884), as the published packages assume."""
    if broker.websockets:
        return str(broker)
    scheme = "wss" if broker.tls else "ws"
    return str(BrokerUrl(scheme, broker.host, min(broker.port + 1, 65535), "/mqtt"))


def on_host(websocket: str, host: str) -> str:
    """Return a websocket URL for other machines: with `host` in place of a loopback address."""
    at = parse_broker_url(websocket)
    return str(replace(at, host=host)) if at.host in ("127.0.0.1", "localhost", "::1") else websocket


def mixed_content_error(page: str, websocket: str) -> str:
    """Return the reason why browsers block this page's connection to the broker, or "". Source: W3C, Mixed Content."""
    is_here = urlsplit(websocket).hostname in ("localhost", "127.0.0.1", "::1")  # allowed by browsers
    if is_here or not (page.startswith("https://") and websocket.startswith("ws://")):
        return ""
    return f"browsers do not let an https page such as {page.partition('?')[0]} reach {websocket}"
