"""A sealed radio between a c-node and its sealed a-node: kernels see plain packets, the a-node and the air sealed ones.

Nothing here is trusted: the a-node makes the seals and looks at them. Source: docs/spec/sealed-radio.md.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace
from typing import Any

from phalanx.bti.elsewhere import Elsewhere
from phalanx.bti.nodes import limits_of
from phalanx.bti.trusted import REASONS
from phalanx.errors import UsageError
from phalanx.net.udp_radio import Allowance, Radio
from phalanx.scenarios.scenario import WHEELS, Scenario
from phalanx.wire import Record, lines
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX, SEAL

LEAST_PER_S = 50.0  # a gateway speaks by its own pace, not by an a-node's buckets
WAITING = 256  # packets that go out whose seals are kept until they are asked for
SENDERS = 64  # that an a-node remembers: PHX_SOURCES in firmware/include/phx_seal.h


def with_room_for_seals(scenario: Scenario) -> Scenario:
    """The scenario with packets that a seal fits behind. Raises: UsageError: more neighbours than a-nodes remember."""
    most = SENDERS - (scenario.controller == WHEELS)  # one more seals: the gateway
    if scenario.bti.n_max > most:
        raise UsageError(f"n_max is {scenario.bti.n_max}, on a sealed radio", f"at most {most} neighbours")
    most = min(scenario.bti.packet_max_bytes, PACKET_MAX - SEAL.size)
    return replace(scenario, bti=replace(scenario.bti, packet_max_bytes=most))


class SealedAir:
    """The radio that a c-node speaks through, and the nodes that it asks: seals stay in between."""

    def __init__(self, node: Elsewhere, radio: Radio) -> None:
        self._node, self._radio = node, radio
        self._going: deque[tuple[bytes, bytes]] = deque(maxlen=WAITING)  # packet, seal
        self._came = b"", b""  # the packet that was taken last, and its seal
        self._refused: Counter[str] = Counter()

    @property
    def refused(self) -> dict[str, int]:
        """Frames that were not taken, by reason: the radio's and the a-node's."""
        return {**self._radio.refused, **self._refused}

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See `Elsewhere`: packets without seals, in and out."""
        if call is lines.RECV:
            packet, (came, seal) = arguments["packet"], self._came
            code, result = self._node.ask(call, now_ms, packet=packet + seal if packet == came else packet)
            if code < 0:
                self._refused[REASONS[code]] += 1
            return code, result
        code, result = self._node.ask(call, now_ms, **arguments)
        if call is not lines.SEND or code < 0:
            return code, result
        entry, seal = result[: -SEAL.size], result[-SEAL.size :]
        self._going.append((entry[ENTRY_HEADER_BYTES:], seal))
        return code - SEAL.size, entry

    def send(self, packet: bytes) -> None:
        """See `Radio`; with the seal that the a-node made for it."""
        self._radio.send(packet + _seal(self._going, packet))

    def take(self) -> bytes:
        """See `Radio`: without its seal, which is kept until the a-node is asked."""
        while sealed := self._radio.take():
            if len(sealed) > SEAL.size:
                self._came = sealed[: -SEAL.size], sealed[-SEAL.size :]
                return self._came[0]
            self._refused["short"] += 1
        return b""

    def fileno(self) -> int:
        """See `Radio`."""
        return self._radio.fileno()


def _seal(waiting: deque[tuple[bytes, bytes]], packet: bytes) -> bytes:
    """The first seal that waits for this packet; none before it waits any longer. b"" for a packet that has none."""
    for n, (each, seal) in enumerate(waiting):
        if each == packet:
            for _ in range(n + 1):
                waiting.popleft()
            return seal
    return b""


def may_send(scenario: Scenario, peers: int, *, sealed: bool = False) -> Allowance:
    """Return what each of so many addresses may say, behind which all other robots are: in an arena they share one.

    Packets are counted alone if they are `sealed`, as an a-node refuses forgeries before they are logged; and where a
    gateway orders robots, as it speaks more than its a-node's buckets would let it.
    """
    limits = limits_of(scenario.bti, scenario.radio)
    behind = max(1, -(-(scenario.robots - 1) // max(1, peers)))
    # Twice: the network may say again what it carried.
    packets_per_s = 2 * (limits.send_us_per_s + limits.audit_us_per_s) / limits.airtime_fixed_us
    packets_per_s = behind * max(LEAST_PER_S, packets_per_s)
    if sealed or scenario.controller == WHEELS:
        return Allowance(packets_per_s)
    return Allowance(
        packets_per_s,
        behind * limits.send_us_per_s,
        behind * limits.send_capacity_us,
        limits.airtime_fixed_us,
        limits.airtime_ns_per_byte_broadcast,
    )
