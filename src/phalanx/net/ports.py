"""TCP ports: search for free ones, and listening; and this machine's address on its network."""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
from collections.abc import Awaitable, Callable
from random import SystemRandom  # not `random`: processes with the same seed would try the same ports
from typing import TypeVar

from phalanx.errors import Unavailable

log = logging.getLogger(__name__)
Started = TypeVar("Started")

LOOPBACK = "127.0.0.1"
# Below the range for outgoing connections, in which a free port may be taken before anything listens on it.
QUIET = range(20_000, 32_768)
PORT_TRIES = 5  # attempts, as a free port may be taken before the program listens on it
BACKLOG = 1024  # connections that wait to be accepted
EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104  # compared with options, not bound


class PortTaken(Unavailable):
    """Another program listens on the port."""


def is_free(port: int, host: str = LOOPBACK) -> bool:
    """Return whether `port` is free at `host` now. Raises: Unavailable: this machine has no such address."""
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
                raise Unavailable(
                    f"cannot listen on {host}: this machine has no such address",
                    "use 0.0.0.0 for every address, 127.0.0.1 for this machine only",
                ) from error
            return False
        return True


def free_port(preferred: int = 0, host: str = LOOPBACK) -> int:
    """Return `preferred` if it is free, else any free port. Raises: Unavailable: this machine has no such address."""
    if is_free(preferred, host) and preferred:
        return preferred
    port = next((port for port in SystemRandom().sample(QUIET, 20) if is_free(port, host)), 0)
    if not port:
        with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
            probe.bind((host, 0))
            port = int(probe.getsockname()[1])
    if preferred:
        log.warning("port %d is in use: using %d instead", preferred, port)
    return port


async def retry_while_port_taken(start: Callable[[], Awaitable[Started]]) -> Started:
    """Call `start`, again if it raises PortTaken because its free port was taken meanwhile; return its result."""
    for _ in range(PORT_TRIES - 1):
        with contextlib.suppress(PortTaken):
            return await start()
    return await start()


def listen(host: str, port: int, if_taken: str = "run phalanx doctor") -> socket.socket:
    """Return a listening socket. Raises: PortTaken, with the hint `if_taken`; Unavailable: another error."""
    family, both = _family(host), host == "::"
    try:
        return socket.create_server((host, port), family=family, backlog=BACKLOG, dualstack_ipv6=both)
    except OSError as error:
        is_taken = error.errno == errno.EADDRINUSE
        why = (error.strerror or str(error)).partition(" (while")[0]  # Python appends the address
        raise (PortTaken if is_taken else Unavailable)(
            f"cannot listen on {host} port {port}: {why}",
            if_taken if is_taken else "use an address of this machine for --host; ports below 1024 need root",
        ) from error


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def lan_address() -> str:
    """Return this machine's address on its network, or loopback if it has none. Sends no packet."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # TEST-NET-1: selects the interface, sends nothing
        address: str = probe.getsockname()[0]
        return address
    return LOOPBACK
