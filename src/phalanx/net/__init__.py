"""I/O of the link, radios and robots' serial lines: brokers, sockets, files and clocks.

Names are imported lazily, so that the front end, a separate process, starts without loading the clients.
"""

from typing import TYPE_CHECKING

from phalanx.loading import loaded_when_used

if TYPE_CHECKING:
    from phalanx.link.qrurl import Login

    from .broker_url import BrokerUrl, parse_broker_url
    from .qrkey_client import QrkeyClient
    from .server import ANY, Server
    from .session_client import Client

__all__ = ["ANY", "BrokerUrl", "Client", "Login", "QrkeyClient", "Server", "parse_broker_url"]

_FOUND_IN = {
    "ANY": "server",
    "BrokerUrl": "broker_url",
    "QrkeyClient": "qrkey_client",
    "Login": "broker_url",
    "Server": "server",
    "Client": "session_client",
    "parse_broker_url": "broker_url",
}

__getattr__ = loaded_when_used(__name__, _FOUND_IN)


def __dir__() -> list[str]:
    return __all__
