"""The world of brokers, sockets and clocks."""

from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl, parse_broker_url
from .client import Client
from .server import ANY, Server

__all__ = ["ANY", "BrokerUrl", "Client", "Login", "Server", "parse_broker_url"]
