"""Where PyDotBot's controller is."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from urllib.parse import urlsplit

from phalanx.errors import UsageError, did_you_mean

DEFAULT_PORT = 8000
HINT = f"dotbot://HOST:PORT, where `dotbot run controller` serves its API: dotbot://127.0.0.1:{DEFAULT_PORT}"


@dataclass(frozen=True, slots=True)
class DotbotUrl:
    """A controller's address."""

    host: str  # name or address, IPv6 without brackets
    port: int

    @property
    def is_here(self) -> bool:
        """Whether only this machine reaches it."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def http(self) -> str:
        """Where its API is."""
        return f"http{str(self).removeprefix('dotbot')}"

    def __str__(self) -> str:
        return f"dotbot://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def parse_dotbot_url(url: str) -> DotbotUrl:
    """The controller at `url`.

    Raises: UsageError: not such a URL.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise UsageError("the swarm's URL has a bad host or port", HINT) from error
    if parts.scheme != "dotbot":
        raise UsageError(f"a swarm at {url!r} is not known", did_you_mean(f"{parts.scheme}://", ["dotbot://"]) + HINT)
    more = (parts.username, parts.password, parts.path.strip("/"), parts.query, parts.fragment)
    if not parts.hostname or port == 0 or any(more):
        raise UsageError("the swarm's URL has no host, or more than host and port", HINT)
    return DotbotUrl(parts.hostname, port or DEFAULT_PORT)
