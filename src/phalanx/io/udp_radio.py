"""A robot's radio over UDP: a frame is a datagram, and what does not come from a configured address was never there.

Nothing here is trusted and nothing is acknowledged: datagrams are lost, repeated and overtake each other, and the
audits hold with that. IPv4 or IPv6, to a list of addresses or to one multicast group.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import os
import socket
import struct
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from phalanx.errors import Unavailable, UsageError
from phalanx.wire.table import FRAME_MAX

ADDRESSES = Path("/proc/net/if_inet6")
# Of one sender so many frames wait at least; of all together so many, if that is more. What comes then is lost.
LEAST_WAITING, MOST_WAITING = 32, 256
# Datagrams that are read at once, more than wait: so a flood is read and lost, and leaves room in the socket.
AT_ONCE = 512
BUFFER_BYTES = 1 << 20
HINT = "ADDRESS:PORT, as 192.168.1.7:4410 or [fd00::7]:4410"
Address = tuple[str, int]


class Radio(Protocol):
    """What a robot speaks through, whatever it is: serial radios are one file each."""

    @property
    def refused(self) -> dict[str, int]:
        """Frames that were dropped, by reason."""
        ...

    def send(self, frame: bytes) -> None:
        """The frame goes out to all who hear this robot, or is lost."""
        ...

    def listen(self, wake: Callable[[], object]) -> None:
        """From now on frames that come are kept, and `wake` is called, in the running event loop, while some wait."""
        ...

    def take(self) -> bytes:
        """The next frame that waits, of each sender in its turn; b"" if there is none."""
        ...

    def close(self) -> None:
        """Nothing comes and goes any more."""
        ...


class UdpRadio:
    """A socket at `here`.

    Args:
        here: where it listens, as in HINT.
        peers: from whom it hears, and to whom it speaks.
        group: a multicast group to speak to instead; it still hears `peers` alone.

    Attributes:
        refused: datagrams that were dropped unread, by reason.
        came_from: who said the frame that is handed over, or was taken last.
    Raises: UsageError: no such address; Unavailable: it cannot listen there.
    """

    def __init__(self, here: str, peers: Sequence[str], group: str = "") -> None:
        self._here = parsed(here)
        self._peers = [parsed(each) for each in peers]
        self._to = [parsed(group)] if group else self._peers
        self._heard = frozenset(self._peers)
        self.refused = {"foreign": 0, "too_large": 0, "empty": 0, "waiting": 0}
        self._waiting: dict[Address, deque[bytes]] = {}  # by sender, who is next first
        self._room = max(LEAST_WAITING, MOST_WAITING // len(peers)) if peers else 0
        self.came_from: Address = ("", 0)
        family = _family(self._here)
        if any(_family(each) != family for each in (*self._peers, *self._to)):
            raise UsageError(f"{here} and its peers are not all IPv4 or all IPv6", "one kind for all")
        if group and not ipaddress.ip_address(self._to[0][0]).is_multicast:
            raise UsageError(f"{group} is no multicast group", "239.1.2.3:4410 or [ff15::4410]:4410, for example")
        if group and any(port != self._to[0][1] for _, port in (self._here, *self._peers)):
            raise UsageError(f"not all speak from port {self._to[0][1]}", "that of the group, for here and peers")
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._bind(self._to[0] if group else None)
        except OSError as error:
            self._socket.close()
            raise Unavailable(f"cannot listen on {here}: {error.strerror}", "an address of this machine's") from error

    def _bind(self, group: Address | None) -> None:
        if not group:
            self._socket.bind(self._here)
            return
        # Robots of one machine share the group's port; each hears all that is said there.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        family = _family(group)
        there, ours = (socket.inet_pton(family, each[0].partition("%")[0]) for each in (group, self._here))
        if family == socket.AF_INET:
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, there + ours)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, ours)
        else:
            index = struct.pack("=I", _interface_of(ours))
            self._socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, there + index)
            # Of an interface's addresses this one, by which the others know us; and that interface.
            self._socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_PKTINFO, ours + index)
        self._socket.bind(group)

    def send(self, frame: bytes) -> None:
        """See `Radio`."""
        for each in self._to:
            self.send_to(frame, each)

    def send_to(self, frame: bytes, address: Address) -> None:
        """The frame goes to one alone, or is lost."""
        with contextlib.suppress(OSError):  # nobody listens there yet, or no room: as lost as on the air
            self._socket.sendto(frame, address)

    def fileno(self) -> int:
        """Of the socket, for `select`."""
        return self._socket.fileno()

    def listen(self, wake: Callable[[], object]) -> None:
        """See `Radio`."""
        asyncio.get_running_loop().add_reader(self._socket, self._keep_all, wake)

    def _keep_all(self, wake: Callable[[], object]) -> None:
        if self.gather():
            wake()

    def gather(self) -> bool:
        """What has come waits to be taken, so far as there is room; whether anything waits."""
        self.read(self._keep)
        return bool(self._waiting)

    def _keep(self, frame: bytes) -> None:
        waiting = self._waiting.setdefault(self.came_from, deque())
        if len(waiting) < self._room:
            waiting.append(frame)
        else:
            self.refused["waiting"] += 1

    def take(self) -> bytes:
        """See `Radio`. Who floods us waits for itself, and the others for one of its frames at most."""
        if not self._waiting:
            return b""
        sender = next(iter(self._waiting))
        waiting = self._waiting.pop(sender)
        self.came_from, frame = sender, waiting.popleft()
        if waiting:
            self._waiting[sender] = waiting  # behind the others
        return frame

    def read(self, on_frame: Callable[[bytes], None]) -> None:
        """What has come is handed over, so far as it is ours to hear."""
        for _ in range(AT_ONCE):
            try:
                raw, came_from = self._socket.recvfrom(FRAME_MAX + 1)
            except OSError:
                return
            if len(raw) > FRAME_MAX:
                self.refused["too_large"] += 1
            elif came_from[:2] not in self._heard:
                self.refused["foreign"] += 1
            elif not raw:
                self.refused["empty"] += 1
            else:
                self.came_from = came_from[:2]
                on_frame(raw)

    def close(self) -> None:
        """See `Radio`."""
        with contextlib.suppress(RuntimeError, ValueError):  # no loop runs, or it never listened
            asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()


def parsed(words: str) -> Address:
    """The address that is said. Raises: UsageError: it is none."""
    host, _, port = words.rpartition(":")
    try:
        address = ipaddress.ip_address(host.removeprefix("[").removesuffix("]") if ":" in host else host)
        if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 0xFFFF):
            raise ValueError(port)
    except ValueError as error:
        raise UsageError(f"{words!r} is no address", HINT) from error
    return str(address), int(port)


def _interface_of(ours: bytes) -> int:
    """The number of the interface that has this IPv6 address. Raises: OSError: none has."""
    for line in ADDRESSES.read_text().splitlines():
        address, index, *_ = line.split()
        if bytes.fromhex(address) == ours:
            return int(index, 16)
    raise OSError(errno.EADDRNOTAVAIL, os.strerror(errno.EADDRNOTAVAIL))


def _family(address: Address) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address[0] else socket.AF_INET
