"""Ports for tests: none is given out twice while tests run, in whichever process.

A port that is free when a test looks can be another test's by the time that a broker listens there: a port drawn at
random once stopped a whole run. Gateways draw theirs from another range and try again.
"""

import fcntl
import os
import socket
import tempfile
from pathlib import Path

from phalanx.net.ports import LOOPBACK, is_free

RANGE = range(10_000, 18_000)
STRIDE = 37  # of a broker elsewhere, browsers' port is guessed as the one after its own: no test may listen there
NEXT = Path(tempfile.gettempdir()) / f"next-port-of-tests-{os.getuid()}"


def free_port(host: str = LOOPBACK) -> int:
    """The next one that nobody listens on."""
    with NEXT.open("a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        begun = int(file.read() or RANGE.start)
        turns = (RANGE.start + (begun - RANGE.start + turn * STRIDE) % len(RANGE) for turn in range(len(RANGE)))
        port = next(port for port in turns if is_free(port, host))
        file.truncate(0)
        file.write(str(port + STRIDE))
        return port


def free_udp_port(host: str = "127.0.0.1") -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((host, 0))
        return probe.getsockname()[1]
