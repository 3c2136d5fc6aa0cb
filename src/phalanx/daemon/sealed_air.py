"""A sealed radio between a c-node and its a-node: kernels see plain packets, the a-node and the air sealed ones.

Nothing here is trusted: the a-node creates and checks the seals. Source: docs/spec/sealed-radio.md.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace
from typing import Any

from phalanx.bti.elsewhere import RemoteNodes
from phalanx.bti.nodes import limits_of
from phalanx.bti.trusted import REASONS
from phalanx.errors import UsageError
from phalanx.net.udp_radio import PeerLimits, Radio
from phalanx.scenarios.scenario import WHEELS, Scenario
from phalanx.wire import Record, lines
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX, SEAL

LEAST_PER_S = 50.0  # a gateway has its own rate, not an a-node's buckets
WAITING = 256  # sealed packets whose seals wait for `send`
SENDERS = 64  # senders that an a-node tracks: PHX_SOURCES in firmware/include/phx_seal.h


def with_room_for_seals(scenario: Scenario) -> Scenario:
    """Return the scenario with packets short enough for a seal. Raises: UsageError: too many neighbours."""
    most = SENDERS - (scenario.controller == WHEELS)  # one for the gateway
    if scenario.bti.n_max > most:
        raise UsageError(f"n_max is {scenario.bti.n_max}, on a sealed radio", f"use at most {most}")
    most = min(scenario.bti.packet_max_bytes, PACKET_MAX - SEAL.size)
    return replace(scenario, bti=replace(scenario.bti, packet_max_bytes=most))


class SealedAir:
    """The radio and the nodes of a c-node, which itself handles packets without seals."""

    def __init__(self, node: RemoteNodes, radio: Radio) -> None:
        self._node, self._radio = node, radio
        self._sent_seals: deque[tuple[bytes, bytes]] = deque(maxlen=WAITING)  # packet, seal
        self._received = b"", b""  # the packet received last, and its seal
        self._refused: Counter[str] = Counter()

    @property
    def refused(self) -> dict[str, int]:
        """Return the packets refused by the radio and the a-node, by reason."""
        return {**self._radio.refused, **self._refused}

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See `RemoteNodes`: packets go in and out without seals."""
        if call is lines.RECV:
            packet, (received, seal) = arguments["packet"], self._received
            code, result = self._node.ask(call, now_ms, packet=packet + seal if packet == received else packet)
            if code < 0:
                self._refused[REASONS[code]] += 1
            return code, result
        code, result = self._node.ask(call, now_ms, **arguments)
        if call is not lines.SEND or code < 0:
            return code, result
        entry, seal = result[: -SEAL.size], result[-SEAL.size :]
        self._sent_seals.append((entry[ENTRY_HEADER_BYTES:], seal))
        return code - SEAL.size, entry

    def send(self, packet: bytes) -> None:
        """See `Radio`; adds the seal that the a-node made for the packet."""
        self._radio.send(packet + _seal(self._sent_seals, packet))

    def take(self) -> bytes:
        """See `Radio`; removes the seal and keeps it for the a-node."""
        while sealed := self._radio.take():
            if len(sealed) > SEAL.size:
                self._received = sealed[: -SEAL.size], sealed[-SEAL.size :]
                return self._received[0]
            self._refused["short"] += 1
        return b""

    def fileno(self) -> int:
        """See `Radio`."""
        return self._radio.fileno()


def _seal(waiting: deque[tuple[bytes, bytes]], packet: bytes) -> bytes:
    """Return the first waiting seal of this packet and drop older ones; b"" if it has none."""
    for n, (each, seal) in enumerate(waiting):
        if each == packet:
            for _ in range(n + 1):
                waiting.popleft()
            return seal
    return b""


def may_send(scenario: Scenario, peers: int, *, sealed: bool = False) -> PeerLimits:
    """Return the allowance of each of `peers` addresses; in an arena all other robots share one address.

    Only the number of packets is limited if they are `sealed`, as an a-node refuses forgeries before they are logged,
    and if a gateway sends orders, as it may exceed an a-node's buckets.
    """
    limits = limits_of(scenario.bti, scenario.radio)
    behind = max(1, -(-(scenario.robots - 1) // max(1, peers)))
    # Twice: the network can duplicate packets.
    packets_per_s = 2 * (limits.send_us_per_s + limits.audit_us_per_s) / limits.airtime_fixed_us
    packets_per_s = behind * max(LEAST_PER_S, packets_per_s)
    if sealed or scenario.controller == WHEELS:
        return PeerLimits(packets_per_s)
    return PeerLimits(
        packets_per_s,
        behind * limits.send_us_per_s,
        behind * limits.send_capacity_us,
        limits.airtime_fixed_us,
        limits.airtime_ns_per_byte_broadcast,
    )
