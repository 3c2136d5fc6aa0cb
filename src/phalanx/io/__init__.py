"""The world of brokers, sockets and clocks."""

from .broker_url import BrokerUrl, Login, parse_broker_url
from .client import Client
from .server import ANY, Server

__all__ = ["ANY", "BrokerUrl", "Client", "Login", "Server", "parse_broker_url"]
