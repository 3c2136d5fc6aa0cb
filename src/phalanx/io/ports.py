"""TCP ports: which are free, and this machine's address as others see it."""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
from random import SystemRandom  # whoever seeds the other one draws what all who do so draw

from phalanx.errors import Unavailable

log = logging.getLogger(__name__)

LOOPBACK = "127.0.0.1"
# Below what systems give to outgoing connections: one of those is soon some flood's, before anybody listens there.
QUIET = range(20_000, 32_768)
PORT_TRIES = 5  # a port that was free can be taken by the time somebody listens there
EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104  # compared with what a person asked for, not bound


class PortTaken(Unavailable):
    """Somebody else listens there."""


def is_free(port: int, host: str = LOOPBACK) -> bool:
    """Whether `port` can be listened on at `host` just now. Raises: Unavailable: this machine has no such address."""
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
                raise Unavailable(
                    f"cannot listen on {host}: this machine has no such address",
                    "0.0.0.0 for every address, 127.0.0.1 for this machine only",
                ) from error
            return False
        return True


def free_port(preferred: int = 0, host: str = LOOPBACK) -> int:
    """`preferred` if it is free, else any free port, which is said.

    Raises: Unavailable: this machine has no such address.
    """
    if is_free(preferred, host) and preferred:
        return preferred
    port = next((port for port in SystemRandom().sample(QUIET, 20) if is_free(port, host)), 0)
    if not port:
        with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
            probe.bind((host, 0))
            port = int(probe.getsockname()[1])
    if preferred:
        log.warning("port %d is in use: %d is taken instead", preferred, port)
    return port


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def lan_address() -> str:
    """This machine's address on its network, or loopback if it has none. No packet is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # TEST-NET-1: only asks which interface would be used
        address: str = probe.getsockname()[0]
        return address
    return LOOPBACK
