"""A robot's radio over UDP: a packet is a datagram, and datagrams from unknown addresses are dropped.

Nothing here is trusted or acknowledged: datagrams may be lost, duplicated and reordered, and audits tolerate that.
IPv4 or IPv6, to a list of addresses or to one multicast group.

Each peer has its own connected socket. So the kernel sorts datagrams by sender and buffers them, and datagrams beyond
the buffer or the allowance of a peer cost this process nothing.
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
# Buffered packets of the longest size: at least so many per sender, or in total, whichever is more.
LEAST_WAITING, MOST_WAITING = 32, 256
LONGEST_TAKES = 2304  # bytes of a socket's buffer per packet; the kernel doubles it for its own data
STRANGERS_KEPT = 1  # bytes: the smallest buffer that the kernel allows, as these datagrams are only counted
COUNTED = 512  # datagrams of strangers counted at a time
SO_MEMINFO, DROPS = 55, struct.Struct("=32xI")  # linux/sock_diag.h: datagrams dropped by a full socket
OF_ADDRESS = "use an address of this machine"
OF_PORT = "use another port, or end the program that listens there (another robot of this machine?)"
HINT = "use ADDRESS:PORT, such as 192.168.1.7:4410 or [fd00::7]:4410"
Address = tuple[str, int]


class Radio(Protocol):
    """Interface of a robot's radio, such as UDP or a serial radio."""

    @property
    def refused(self) -> Mapping[str, int]:
        """Number of dropped packets, by reason."""

    def send(self, frame: bytes) -> None:
        """Broadcast a packet; it may be lost."""

    def take(self) -> bytes:
        """Return the next received packet, round-robin over the senders; b"" if there is none."""

    def fileno(self) -> int:
        """Return a file descriptor that is readable while packets wait."""


@dataclass(frozen=True, slots=True)
class PeerLimits:
    """Receive limits of one peer: at most what its a-node lets it send.

    Attributes:
        packets_per_s: datagrams read per second, with a burst of one second's number; further ones stay buffered.
        send_us_per_s, send_capacity_us, fixed_us, ns_per_byte: airtime of packets other than audits', as in the
            `Limits` of an a-node; packets above the limit are dropped, because they would fill the log.
    """

    packets_per_s: float = 1000.0
    send_us_per_s: float = math.inf
    send_capacity_us: float = math.inf
    fixed_us: float = 0.0
    ns_per_byte: float = 0.0


class _Peer:
    """A peer's socket, and its remaining allowance."""

    def __init__(self, here: Address, address: Address, room: int, may: PeerLimits, *, shared: bool) -> None:
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
        """Return whether its next datagram may be read now."""
        now_s, may = time.monotonic(), self._may
        self._frames = min(self._most, self._frames + (now_s - self._at_s) * may.packets_per_s)
        self._send_us = min(may.send_capacity_us, self._send_us + (now_s - self._at_s) * may.send_us_per_s)
        self._at_s = now_s
        return self._frames >= 1

    def read(self) -> tuple[bytes, Address]:
        """Return its next datagram and the sender's address. Raises: OSError: none waits, or an ICMP error."""
        self._frames -= 1
        raw, came_from = self.socket.recvfrom(PACKET_MAX + 1)
        return raw, came_from[:2]

    def may_send(self, frame: bytes) -> bool:
        """Return whether its a-node's airtime limit allows this packet. Source: docs/spec/rebound-nodes.md."""
        took_us = self._may.fixed_us + self._may.ns_per_byte * len(frame) / 1000
        if frame[0] & KIND_AUDIT:
            return True
        if took_us > self._send_us:
            return False
        self._send_us -= took_us
        return True


ANYTHING = PeerLimits()


class UdpRadio:
    """Radio with a socket at `here` for sending, and one for receiving from each peer.

    Args:
        here: address to listen on, in the form of HINT.
        peers: addresses to receive from and send to.
        group: multicast group to send to instead; packets are still received only from `peers`.
        may: receive limits of each peer.

    Attributes:
        came_from: sender of the packet that `take` returned last.
    Raises: UsageError: an address is not valid; Unavailable: it cannot listen there.
    """

    def __init__(self, here: str, peers: Sequence[str], group: str = "", may: PeerLimits = ANYTHING) -> None:
        self._here = parse_address(here)
        addresses = list(dict.fromkeys(map(parse_address, peers)))
        self._to = [parse_address(group)] if group else addresses
        self._refused = {"foreign": 0, "too_large": 0, "empty": 0, "too_many": 0}
        self.came_from: Address = ("", 0)
        family = _family(self._here)
        if any(_family(each) != family for each in (*addresses, *self._to)):
            raise UsageError(f"{here} and its peers are not all IPv4 or all IPv6", "use the same version for all")
        if group and not ipaddress.ip_address(self._to[0][0]).is_multicast:
            hint = "use an address such as 239.1.2.3:4410 or [ff15::4410]:4410"
            raise UsageError(f"{group} is not a multicast group", hint)
        if group and any(port != self._to[0][1] for _, port in (self._here, *addresses)):
            hint = "use the port of the group for this robot and all peers"
            raise UsageError(f"not all robots use port {self._to[0][1]}", hint)
        room = max(LEAST_WAITING, MOST_WAITING // max(1, len(addresses)))
        self._is_group = bool(group)
        self._epoll = select.epoll()
        self._peers: dict[int, _Peer] = {}
        self._turns: dict[int, None] = {}  # peers with waiting datagrams, in their order
        self._paused: set[int] = set()
        self._socket = _made(family, 0 if group else STRANGERS_KEPT)
        try:
            at = self._bind(self._to[0] if group else None)
            # The bind succeeded, so the port is ours. SO_REUSEPORT is set only while our other sockets share it.
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
        """Bind the sending socket; return the address for the peers' sockets."""
        if not group:
            self._socket.bind(self._here)
            return self._here
        # Robots on one machine share the group's port, and each receives all its datagrams.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        family = _family(group)
        there, ours = (socket.inet_pton(family, each[0].partition("%")[0]) for each in (group, self._here))
        if family == socket.AF_INET:
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, there + ours)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, ours)
        else:
            index = struct.pack("=I", _interface_of(ours))
            self._socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, there + index)
            # Send from this address of the interface, because the peers know this robot by it.
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
        """Number of dropped datagrams, by reason; `waiting`: dropped by the kernel because the buffer was full."""
        self._count_strangers()
        waiting = sum(_dropped(peer.socket) for peer in self._peers.values())
        # A group's datagrams reach all sockets: those dropped here may be from peers.
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
        """Send a packet to one address; it may be lost."""
        with contextlib.suppress(OSError):  # no listener yet, or a full buffer: the packet is lost
            self._socket.sendto(frame, address)

    def fileno(self) -> int:
        """See `Radio`; peers without an allowance left do not make it readable."""
        return self._epoll.fileno()

    def take(self) -> bytes:
        """See `Radio`. A peer that floods delays the others by at most one of its packets."""
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
        if came_from != peer.address:  # arrived before the socket was connected
            return "foreign"
        if len(raw) > PACKET_MAX:
            return "too_large"
        if not raw:
            return "empty"
        return "" if peer.may_send(raw) else "too_many"

    def close(self) -> None:
        """Close all sockets."""
        self._epoll.close()
        for each in self._sockets:
            each.close()


def parse_address(text: str) -> Address:
    """Parse "ADDRESS:PORT". Raises: UsageError: not valid."""
    host, _, port = text.rpartition(":")
    try:
        address = ipaddress.ip_address(host.removeprefix("[").removesuffix("]") if ":" in host else host)
        if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 0xFFFF):
            raise ValueError(port)
    except ValueError as error:
        raise UsageError(f"{text!r} is not an address", HINT) from error
    return str(address), int(port)


def _made(family: socket.AddressFamily, buffer_bytes: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setblocking(False)
    if buffer_bytes:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    return made


def _dropped(made: socket.socket) -> int:
    """Return the datagrams that a full socket dropped; 0 if the system does not report it, or it is closed."""
    try:
        return int(DROPS.unpack(made.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, DROPS.size))[0])
    except OSError:
        return 0


def _interface_of(ours: bytes) -> int:
    """Return the index of the interface with this IPv6 address. Raises: OSError: there is none."""
    for line in ADDRESSES.read_text().splitlines():
        address, index, *_ = line.split()
        if bytes.fromhex(address) == ours:
            return int(index, 16)
    raise OSError(errno.EADDRNOTAVAIL, os.strerror(errno.EADDRNOTAVAIL))


def _family(address: Address) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address[0] else socket.AF_INET
