"""Real-time radio between processes: each sends UDP to one port, which forwards the packets to robots in range.

The radio loses, delays, reorders and repeats packets. Unicast packets are retried as in Wi-Fi; broadcasts are sent
once. Source: docs/guides/robot.md.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from phalanx.bti import request
from phalanx.config.parameter import check_limits, within
from phalanx.config.radio import RadioConfig
from phalanx.net.ports import LOOPBACK
from phalanx.wire.airtime import broadcast_us, rates_of, unicast_us
from phalanx.wire.driven import EVERYBODY, ORDER
from phalanx.wire.fields import get_u16, row
from phalanx.wire.table import PACKET_MAX
from phalanx.world.audited.world import World
from phalanx.world.radio.channel import (
    AIRTIME_US,
    APP_BROADCAST,
    ARRIVED,
    AUDIT_BROADCAST,
    AUDIT_UNICAST,
    BYTES,
    DUE,
    SENT,
)
from phalanx.world.radio.reach import in_range

AT_ID = ORDER.at("id")
AT_ONCE = 64
LEAST_DELAY_S = 0.0005
BUFFER_BYTES = 1 << 22


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioConditions:
    """Loss, delay and repetition of packets, and clock drift. Raises: UsageError: a value is out of range."""

    repeats: float = within(0.0, 0.0, 0.9, "share of packets that arrive twice")
    delay_ms: float = within(5.0, 0.0, 10_000.0, "largest delay of a packet; packets may overtake each other")
    cut: int = within(0, 0, 65_535, "number of robots, the first ones, that are cut off from the others; 0: no cut")
    cut_at_s: float = within(10.0, 0.0, 1e9, "time from which the cut holds")
    clock_ppm: int = within(0, 0, 1000, "largest drift of the trusted processes' clocks")
    speed: float = within(1.0, 0.05, 1.0, "speed of all clocks and bodies, relative to real time")

    def __post_init__(self) -> None:
        check_limits(self)


class ArenaRadio:
    """Simulated radio at a UDP `port` of this machine, which counts packets in the world's statistics.

    The last of `ports` may belong to a gateway, in range of all. `is_silent(index)` returns True if a radio is off.
    """

    def __init__(
        self,
        world: World,
        config: RadioConfig,
        weather: RadioConditions,
        ports: Sequence[int],
        is_silent: Callable[[int], bool],
        dice: random.Random,
    ) -> None:
        self._world, self._config, self._weather, self._dice = world, config, weather, dice
        self._ports, self._is_silent, self._robots = ports, is_silent, len(world.fleet.robot)
        self._index = {(LOOPBACK, port): i for i, port in enumerate(ports)}
        self._rates = rates_of(config)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._socket.setblocking(False)
        self._socket.bind((LOOPBACK, 0))
        self.port = int(self._socket.getsockname()[1])

    async def carry(self) -> None:
        """Forward packets until this task is cancelled."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket, self._receive)
        try:
            await loop.create_future()
        finally:
            loop.remove_reader(self._socket)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def _receive(self) -> None:
        for _ in range(AT_ONCE):
            try:
                packet, where = self._socket.recvfrom(PACKET_MAX + 1)
            except OSError:
                return
            i = self._index.get(where, -1)
            if i >= 0 and 0 < len(packet) <= PACKET_MAX and not self._is_silent(i):
                self._send(i, packet)

    def _send(self, i: int, packet: bytes) -> None:
        if i == self._robots:
            self._carry_order(packet)
            return
        if self._robots < len(self._ports) and self._dice.random() >= self._config.loss:
            self._put(self._robots, packet)
        reach = self._world.reach
        near = reach.ids[reach.near[i] : in_range(reach, i)].tolist()
        is_audit = bool(packet[0] & request.AUDIT)
        dst = int(get_u16(row(packet), request.AT_DST)) if is_audit and len(packet) >= request.AUDIT_HEAD_BYTES else 0
        took_us = int(unicast_us(self._rates, len(packet)) if dst else broadcast_us(self._rates, len(packet)))
        lost, counts = self._config.loss, self._world.air.counts[i]
        if dst:
            near = [j for j in near if j == dst - 1]
            tries = next((k for k in range(1, self._config.tries) if self._dice.random() >= lost), self._config.tries)
            kind, took_us = AUDIT_UNICAST, tries * took_us
            # Packets that arrive before the last attempt always arrive; only the last attempt may be lost.
            lost = lost if tries == self._config.tries else 0.0
        else:
            kind = AUDIT_BROADCAST if is_audit else APP_BROADCAST
        count = counts[kind]
        count[SENT] += 1
        count[BYTES] += len(packet)
        count[AIRTIME_US] += took_us
        count[DUE] += 1 if dst else len(near)
        for j in near:
            if self._dice.random() >= lost:
                count[ARRIVED] += 1
                for _ in range(1 + (self._dice.random() < self._weather.repeats)):
                    self._put(j, packet)

    def _carry_order(self, packet: bytes) -> None:
        """Forward a gateway's order; it is not retried, and not counted among the robots' packets."""
        to = get_u16(row(packet), AT_ID) if len(packet) > AT_ID + 1 else 0
        for j in range(self._robots) if to == EVERYBODY else [to - 1]:
            if j < self._robots and self._dice.random() >= self._config.loss:
                self._put(j, packet)

    def _put(self, to: int, packet: bytes) -> None:
        late_s = LEAST_DELAY_S + self._dice.random() * self._weather.delay_ms / 1000 / self._weather.speed
        asyncio.get_running_loop().call_later(late_s, self._deliver, to, packet)

    def _deliver(self, to: int, packet: bytes) -> None:
        if not self._is_silent(to):
            with contextlib.suppress(OSError):  # buffer full, or no receiver: lost
                self._socket.sendto(packet, (LOOPBACK, self._ports[to]))
