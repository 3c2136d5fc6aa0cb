"""A robot's radio over UDP: a frame is a datagram, and what does not come from a configured address was never there.

Nothing here is trusted and nothing is acknowledged: datagrams are lost, repeated and overtake each other, and the
audits hold with that. IPv4 or IPv6, to a list of addresses or to one multicast group.

Each peer has a socket of its own, connected to it. So the system sorts senders, frames wait there until they are taken,
and what nobody has room or an allowance for costs this process nothing.
"""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import math
import os
import select
import socket
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from phalanx.errors import Unavailable, UsageError
from phalanx.wire.table import KIND_AUDIT, PACKET_MAX

ADDRESSES = Path("/proc/net/if_inet6")
# Of one sender so many of the longest frames wait at least; of all together so many, if that is more.
LEAST_WAITING, MOST_WAITING = 32, 256
LONGEST_TAKES = 2304  # of a socket's buffer, which the system doubles for what it keeps with a frame
STRANGERS_KEPT = 1  # bytes: as little as the system allows, since nobody reads them but to count
COUNTED = 512  # strangers' datagrams at a time
SO_MEMINFO, DROPS = 55, struct.Struct("=32xI")  # linux/sock_diag.h: what a socket had no room for
OF_ADDRESS = "an address of this machine's"
OF_PORT = "another port, or end what listens there: another robot of this machine?"
HINT = "ADDRESS:PORT, as 192.168.1.7:4410 or [fd00::7]:4410"
Address = tuple[str, int]


class Radio(Protocol):
    """What a robot speaks through, whatever it is: serial radios are one file each."""

    @property
    def refused(self) -> Mapping[str, int]:
        """Frames that were dropped, by reason."""

    def send(self, frame: bytes) -> None:
        """The frame goes out to all who hear this robot, or is lost."""

    def take(self) -> bytes:
        """The next frame that waits, of each sender in its turn; b"" if there is none."""

    def fileno(self) -> int:
        """A file that can be read while some wait."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """What one peer may say: what its a-node lets through, whatever its radio does.

    Attributes:
        packets_per_s: so many datagrams are read, and at first as many as in a second; the others wait.
        send_us_per_s, send_capacity_us, fixed_us, ns_per_byte: airtime of frames that are none of the audits', as an
            a-node's `Limits` have it; what is above that is read and dropped, as it would fill the log.
    """

    packets_per_s: float = 1000.0
    send_us_per_s: float = math.inf
    send_capacity_us: float = math.inf
    fixed_us: float = 0.0
    ns_per_byte: float = 0.0


class _Peer:
    """Whom we hear: its socket, and what it may still say now."""

    def __init__(self, here: Address, address: Address, room: int, may: Allowance, *, shared: bool) -> None:
        self.address = address
        self.socket = _made(_family(here), room * LONGEST_TAKES)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            if shared:
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.socket.bind(here)
            self.socket.connect(address)
        except OSError:
            self.socket.close()
            raise
        self._may, self._most = may, max(may.packets_per_s, LEAST_WAITING)
        self._frames, self._send_us, self._at_s = self._most, may.send_capacity_us, time.monotonic()

    def may_be_read(self) -> bool:
        """Whether its next datagram may be read now."""
        now_s, may = time.monotonic(), self._may
        self._frames = min(self._most, self._frames + (now_s - self._at_s) * may.packets_per_s)
        self._send_us = min(may.send_capacity_us, self._send_us + (now_s - self._at_s) * may.send_us_per_s)
        self._at_s = now_s
        return self._frames >= 1

    def read(self) -> tuple[bytes, Address]:
        """Its next datagram, and whose it is. Raises: OSError: there is none, or nobody listens there."""
        self._frames -= 1
        raw, came_from = self.socket.recvfrom(PACKET_MAX + 1)
        return raw, came_from[:2]

    def may_send(self, frame: bytes) -> bool:
        """Whether its a-node may have let this through. Source: docs/spec/rebound-nodes.md."""
        took_us = self._may.fixed_us + self._may.ns_per_byte * len(frame) / 1000
        if frame[0] & KIND_AUDIT:
            return True
        if took_us > self._send_us:
            return False
        self._send_us -= took_us
        return True


ANYTHING = Allowance()


class UdpRadio:
    """A socket at `here`, and one for each peer.

    Args:
        here: where it listens, as in HINT.
        peers: from whom it hears, and to whom it speaks.
        group: a multicast group to speak to instead; it still hears `peers` alone.
        may: what each peer may say.

    Attributes:
        came_from: who said the frame that was taken last.
    Raises: UsageError: no such address; Unavailable: it cannot listen there.
    """

    def __init__(self, here: str, peers: Sequence[str], group: str = "", may: Allowance = ANYTHING) -> None:
        self._here = parsed(here)
        addresses = list(dict.fromkeys(map(parsed, peers)))
        self._to = [parsed(group)] if group else addresses
        self._refused = {"foreign": 0, "too_large": 0, "empty": 0, "too_many": 0}
        self.came_from: Address = ("", 0)
        family = _family(self._here)
        if any(_family(each) != family for each in (*addresses, *self._to)):
            raise UsageError(f"{here} and its peers are not all IPv4 or all IPv6", "one kind for all")
        if group and not ipaddress.ip_address(self._to[0][0]).is_multicast:
            raise UsageError(f"{group} is no multicast group", "239.1.2.3:4410 or [ff15::4410]:4410, for example")
        if group and any(port != self._to[0][1] for _, port in (self._here, *addresses)):
            raise UsageError(f"not all speak from port {self._to[0][1]}", "that of the group, for here and peers")
        room = max(LEAST_WAITING, MOST_WAITING // max(1, len(addresses)))
        self._is_group = bool(group)
        self._epoll = select.epoll()
        self._peers: dict[int, _Peer] = {}
        self._turns: dict[int, None] = {}  # who is next, first
        self._paused: set[int] = set()
        self._socket = _made(family, 0 if group else STRANGERS_KEPT)
        try:
            at = self._bind(self._to[0] if group else None)
            # Nobody else was bound there, and from here on nobody else can be: only those between may share it.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            for each in addresses:
                peer = _Peer(at, each, room, may, shared=self._is_group)
                self._peers[peer.socket.fileno()] = peer
                self._epoll.register(peer.socket, select.EPOLLIN)
            for made in self._sockets:
                made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 0)
        except OSError as error:
            self.close()
            hint = OF_ADDRESS if error.errno != errno.EADDRINUSE else OF_PORT
            raise Unavailable(f"cannot listen on {here}: {error.strerror}", hint) from error

    def _bind(self, group: Address | None) -> Address:
        """Where all of our sockets are bound."""
        if not group:
            self._socket.bind(self._here)
            return self._here
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
        return group

    @property
    def _sockets(self) -> Iterator[socket.socket]:
        yield self._socket
        for peer in self._peers.values():
            yield peer.socket

    @property
    def refused(self) -> dict[str, int]:
        """Datagrams that were dropped, by reason; `waiting` are those that found no room, none of them read."""
        self._count_strangers()
        waiting = sum(_dropped(peer.socket) for peer in self._peers.values())
        # A group's words come to all sockets: what found no room among strangers' was perhaps a peer's.
        unseen = 0 if self._is_group else _dropped(self._socket)
        return {**self._refused, "foreign": self._refused["foreign"] + unseen, "waiting": waiting}

    def _count_strangers(self) -> None:
        heard = {peer.address for peer in self._peers.values()}
        for _ in range(COUNTED):
            try:
                _, came_from = self._socket.recvfrom(1)
            except OSError:
                return
            self._refused["foreign"] += came_from[:2] not in heard

    def send(self, frame: bytes) -> None:
        """See `Radio`."""
        for each in self._to:
            self.send_to(frame, each)

    def send_to(self, frame: bytes, address: Address) -> None:
        """The frame goes to one alone, or is lost."""
        with contextlib.suppress(OSError):  # nobody listens there yet, or no room: as lost as on the air
            self._socket.sendto(frame, address)

    def fileno(self) -> int:
        """See `Radio`; who has had its allowance for now does not count."""
        return self._epoll.fileno()

    def take(self) -> bytes:
        """See `Radio`. Who floods us waits for itself, and the others for one of its frames at most."""
        for fd in [each for each in self._paused if self._peers[each].may_be_read()]:
            self._paused.remove(fd)
            self._epoll.register(fd, select.EPOLLIN)
        for fd, _ in self._epoll.poll(0):
            self._turns.setdefault(fd)
        while self._turns:
            fd = next(iter(self._turns))
            del self._turns[fd]
            peer = self._peers[fd]
            try:
                raw, came_from = peer.read()
            except OSError:
                continue
            finally:
                if not peer.may_be_read():
                    self._paused.add(fd)
                    self._epoll.unregister(fd)
            if why := self._why_not(peer, raw, came_from):
                self._refused[why] += 1
                continue
            self.came_from = came_from
            return raw
        return b""

    def _why_not(self, peer: _Peer, raw: bytes, came_from: Address) -> str:
        if came_from != peer.address:  # before its socket was connected
            return "foreign"
        if len(raw) > PACKET_MAX:
            return "too_large"
        if not raw:
            return "empty"
        return "" if peer.may_send(raw) else "too_many"

    def close(self) -> None:
        """Nothing comes and goes any more."""
        self._epoll.close()
        for each in self._sockets:
            each.close()


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


def _made(family: socket.AddressFamily, buffer_bytes: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setblocking(False)
    if buffer_bytes:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    return made


def _dropped(made: socket.socket) -> int:
    """Datagrams that found no room in a socket; 0 where the system does not say, and of one that is closed."""
    try:
        return int(DROPS.unpack(made.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, DROPS.size))[0])
    except OSError:
        return 0


def _interface_of(ours: bytes) -> int:
    """The number of the interface that has this IPv6 address. Raises: OSError: none has."""
    for line in ADDRESSES.read_text().splitlines():
        address, index, *_ = line.split()
        if bytes.fromhex(address) == ours:
            return int(index, 16)
    raise OSError(errno.EADDRNOTAVAIL, os.strerror(errno.EADDRNOTAVAIL))


def _family(address: Address) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address[0] else socket.AF_INET
