"""Qrkey Fig. 4: packet loss and latency through a broker, and the overhead of our sealing.

Every 500 ms a packet of 20 characters is published and received again by subscribing to its topic. It is sent once in
plain and once sealed, half an interval apart, so that both use the same broker and network. The packet is

    7 digits   sequence number, from 0
    13 digits  time of sending, milliseconds since 1970

A packet counts as back only if all 20 characters match. A sealed packet is the payload of the link's envelope, opened
with a replay cache as in any client. Both kinds use topics of the link's own form and length, new for every run.
Latency is monotonic time from before sealing and sending until the packet was received and opened.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from phalanx.config import LinkConfig
from phalanx.crypto import IV_BYTES
from phalanx.errors import OpenError, Unavailable
from phalanx.link import Epoch, derive_epoch, new_pin
from phalanx.link.envelope import Envelope, encode_envelope, open_envelope, seal
from phalanx.link.messages import Publish
from phalanx.link.replay import ReplayCache
from phalanx.link.topics import full_topic
from phalanx.net import Login
from phalanx.net.broker import RunningBroker, open_broker
from phalanx.net.connection import Connection
from phalanx.papers.table import TableFile, version

from .fig4_table import KINDS, Kind, Row, cells, compare, head, packets, report

__all__ = ["compare", "make_packet", "measure", "report"]

log = logging.getLogger(__name__)

CSV_NAME = "link-fig4.csv"
LINK = LinkConfig()
CLOSE_TIMEOUT_S = 1.0


async def measure(
    folder: Path,
    on_progress: Callable[[int, int], None] = lambda _sent, _of: None,
    *,
    duration: float = 60.0,
    broker: str = "mosquitto",
    login: Login | None = None,
    interval_s: float = 0.5,
    lost_after_s: float = 10.0,
    connect_timeout_s: float = 15.0,
) -> Path:
    """Complete the CSV in `folder` with all packets of `duration` seconds, and continue an interrupted run.

    Args:
        on_progress: called before each packet with its number and the total.
        interval_s: time between two packets of one kind, as in the paper.
        lost_after_s: a packet that is not back by then is lost. The paper gives no timeout.
        connect_timeout_s: time limit for the first connection; later reconnections have none.
    Returns: the CSV's path.
    Raises: UsageError: a bad URL, or a CSV of another measurement. Unavailable: no broker, or the disk is full.
    """
    path = folder / CSV_NAME
    async with open_broker(broker, login=login) as running:
        begin = head(
            broker=str(running.url) if running.name == "external" else running.name,
            interval_s=interval_s,
            lost_after_s=lost_after_s,
            version=version(),
        )
        with TableFile(path, begin, packets) as file:
            probe = _Probe(running, file, round(duration / interval_s), connect_timeout_s, on_progress)
            if min(probe.next_seq.values()) < probe.count:
                await probe.run()
    return path


class _Probe:
    """Sender of `count` packets of each kind at fixed times, independent of replies; records every outcome."""

    def __init__(
        self,
        broker: RunningBroker,
        file: TableFile,
        count: int,
        connect_timeout_s: float,
        on_progress: Callable[[int, int], None],
    ) -> None:
        self.count = count
        self.next_seq = {kind: rows[-1].seq + 1 if rows else 0 for kind, rows in packets(file.table).items()}
        self._file = file
        self._interval_s: float = file.table.origin["interval_s"]
        self._lost_after_s: float = file.table.origin["lost_after_s"]
        self._connect_timeout_s = connect_timeout_s
        self._on_progress = on_progress
        self._epochs: dict[Kind, Epoch] = {kind: derive_epoch(new_pin(LINK.pin_digits, os.urandom)) for kind in KINDS}
        self._topics = {kind: full_topic(LINK.root, self._epochs[kind].topic, "notify") for kind in KINDS}
        self._cache = ReplayCache(LINK.replay_capacity, LINK.tolerance_s)
        # By packet: its sequence number, and wall clock and monotonic clock at the time of sending.
        self._under_way: dict[tuple[Kind, str], tuple[int, float, float]] = {}
        self._given_up: dict[tuple[Kind, str], tuple[int, float, float]] = {}
        self._sending: set[asyncio.Task[bool]] = set()
        self._link = Connection(
            broker.url,
            f"phalanx-fig4-{os.urandom(8).hex()}",
            self._topics.values,
            self._on_message,
            self._on_connect,
        )

    async def run(self) -> None:
        """Send the missing packets, and wait until each packet is back or lost.

        Raises: Unavailable: no broker at the start, or the disk is full.
        """
        connection = self._link.start()
        pacing = asyncio.create_task(self._pace())
        try:
            # A connection that fails permanently must end the measurement, not look like 100 % loss.
            done, _ = await asyncio.wait((connection, pacing), return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except asyncio.CancelledError:
            # Neither back nor lost: dropping them would hide losses, counting them as lost would invent some.
            for (kind, _), (seq, sent_at_s, _) in self._under_way.items():
                self._write(Row(seq, kind, sent_at_s, "cut"))
            raise
        finally:
            tasks: tuple[asyncio.Task[Any], ...] = (connection, pacing, *self._sending)
            for task in tasks:
                task.cancel()
            # A broker that does not respond must not block the exit.
            await asyncio.wait(tasks, timeout=CLOSE_TIMEOUT_S)

    async def _pace(self) -> None:
        try:
            await self._link.wait_connected(self._connect_timeout_s)
        except TimeoutError as error:
            raise Unavailable(str(error), "check host, port and firewall") from error
        due_s = time.monotonic()
        for seq in range(min(self.next_seq.values()), self.count):
            self._on_progress(seq, self.count)
            for kind in KINDS:
                if seq >= self.next_seq[kind]:
                    await asyncio.sleep(max(0.0, due_s - time.monotonic()))
                    self._send(kind, seq)
                    self._give_up()
                # After the machine slept, do not send the missed packets in a burst: that would be another measurement.
                due_s = max(due_s, time.monotonic() - self._interval_s) + self._interval_s / 2
        self._on_progress(self.count, self.count)
        while self._under_way:
            await asyncio.sleep(min(0.05, self._lost_after_s / 10))
            self._give_up()

    def _send(self, kind: Kind, seq: int) -> None:
        now_s = time.time()
        packet = make_packet(seq, now_s)
        self._under_way[kind, packet] = seq, now_s, time.monotonic()
        payload = packet.encode()
        if kind == "sealed":
            payload = seal(encode_envelope(packet, now_s), self._epochs[kind], os.urandom(IV_BYTES))
        # Not awaited: a stalled broker must not delay the next packets, whose latency would then look short. A packet
        # that cannot be sent is not sent later, and so counts as lost.
        task = asyncio.create_task(self._link.send((Publish(self._topics[kind], payload),)))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _on_message(self, topic: str, payload: bytes) -> None:
        kind: Kind = "sealed" if topic == self._topics["sealed"] else "plain"
        try:
            packet = self._open(payload) if kind == "sealed" else payload.decode("ascii")
        except (OpenError, UnicodeDecodeError) as error:
            # A public broker may deliver messages of other clients.
            log.debug("not a packet: %s", error)
            return
        now_s = time.monotonic()
        if sent := self._under_way.pop((kind, packet), None):
            self._write(Row(sent[0], kind, sent[1], "back", (now_s - sent[2]) * 1000))
        elif sent := self._given_up.pop((kind, packet), None):
            self._write(Row(sent[0], kind, sent[1], "late", (now_s - sent[2]) * 1000))

    def _open(self, payload: bytes) -> str:
        opened = open_envelope(payload, self._epochs["sealed"], time.time(), self._cache, LINK.max_to_client_bytes)
        assert isinstance(opened, Envelope), "the envelope was opened without accepting pin messages"
        return str(opened.payload)

    def _write(self, row: Row) -> None:
        self._file.append_line(cells(row))

    async def _on_connect(self, again: bool) -> None:
        log.debug("%s", "reconnected" if again else "connected")

    def _give_up(self) -> None:
        oldest_s = time.monotonic() - self._lost_after_s
        for key in [key for key, sent in self._under_way.items() if sent[2] <= oldest_s]:
            sent = self._under_way.pop(key)
            self._write(Row(sent[0], key[0], sent[1], "lost"))
            self._given_up[key] = sent


def make_packet(seq: int, now_s: float) -> str:
    """Return the 20 characters of a packet: 7 digits of sequence number, 13 of milliseconds since 1970."""
    return f"{seq:07d}{int(now_s * 1000):013d}"
