"""MQTT client that checks the size and form of each packet before it is parsed.

paho's time for the MQTT 5 properties of a packet grows with the square of their number: a packet of half a megabyte
with 100 000 empty properties blocked a gateway for 90 s. So packets that are expensive to parse are dropped first.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable
from typing import Any, Self

import aiomqtt
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.exception import MalformedPacket

from phalanx.errors import PeerError, TooLarge, WrongTopic

from .broker_packets import Answer, Arrived, BrokerFaultError, BrokerPackets

# Longest time for which an endless stream of packets holds up the event loop; long enough to empty a socket.
READ_FOR_S = 0.005
READ_BYTES = 64 * 1024
BEAT_S = 0.05


class SocketEmptiedAt:
    """Time at which the socket was last known to be empty: messages read now arrived after it.

    The kernel does not report when a message arrived. Messages wait in the socket while the event loop is blocked, or
    when they arrive faster than they are read.
    """

    def __init__(self) -> None:
        self.at_s = self._beat_s = time.monotonic()
        self._empty = True

    def read(self, empty: bool) -> None:
        """Record that packets were read, and whether the socket is `empty` now."""
        self._empty = empty
        if empty:
            self.at_s = time.monotonic()

    async def watch(self) -> None:
        """Update the time while no packets arrive; runs until cancelled."""
        while True:
            await asyncio.sleep(BEAT_S)
            # The event loop has polled the socket since the last beat, so whatever arrived before that beat has been
            # read. The time of the poll itself is not known.
            if self._empty:
                self.at_s = max(self.at_s, self._beat_s)
            self._beat_s = time.monotonic()


class CheckedClient(aiomqtt.Client):
    """aiomqtt client with its own reading: messages bypass paho, and paho parses only small packets.

    paho makes three system calls and needs 60 µs for each packet, and other threads may run at each call.

    Args:
        way: a socket that is connected to the broker already, if there is one.
        arrived: called with each message.
        on_dropped: called with the error for each message that is dropped.
        emptied: updated when the socket is empty.
    """

    def __init__(
        self,
        *where: Any,
        way: socket.socket | None,
        arrived: Callable[[Arrived], None],
        on_dropped: Callable[[PeerError], object],
        emptied: SocketEmptiedAt,
        **more: Any,
    ) -> None:
        super().__init__(*where, **more)
        self._arrived, self._on_dropped = arrived, on_dropped
        self._emptied = emptied
        self._again: asyncio.Handle | None = None
        paho: Any = self._client
        self._packets = BrokerPackets(5 if paho._protocol == aiomqtt.ProtocolVersion.V5 else 4)  # noqa: SLF001
        # Otherwise an exception in a callback of aiomqtt would end the reading.
        paho.suppress_exceptions = True
        self._dial, paho._create_socket_connection = paho._create_socket_connection, self._dialled  # noqa: SLF001
        self._way = way

    async def __aenter__(self) -> Self:
        # paho connects in a thread that cannot be cancelled: closing its socket makes it fail.
        try:
            async with asyncio.timeout(self.timeout):
                return await super().__aenter__()
        except BaseException:
            if self._way:
                with contextlib.suppress(OSError):
                    self._way.shutdown(socket.SHUT_RDWR)
            raise
        finally:
            if self._way:
                self._way.close()

    def _dialled(self) -> socket.socket:
        way: socket.socket = self._way or self._dial()
        self._way = way.dup()  # TLS takes over the original socket
        return way

    def _on_socket_open(self, client: Any, userdata: Any, sock: Any) -> None:
        # Called in the connecting thread. Under TLS aiomqtt's own reader does not return while packets arrive.
        super()._on_socket_open(client, userdata, sock)
        self._loop.call_soon_threadsafe(self._loop.add_reader, sock.fileno(), self._read)

    def _read(self) -> None:
        """Read packets until the socket is empty, or for `READ_FOR_S`."""
        paho: Any = self._client
        until_s = time.monotonic() + READ_FOR_S
        if self._again:  # avoid a further pending call for each turn of the loop with a readable socket
            self._again.cancel()
        try:
            while time.monotonic() < until_s:
                if paho._sock is None:  # noqa: SLF001
                    return
                code = self._read_one(paho)
                if code > 0:
                    paho._loop_rc_handle(code)  # noqa: SLF001
                    return
            self._emptied.read(empty=False)
            self._again = self._loop.call_soon(self._read)
        except BlockingIOError:
            self._emptied.read(empty=True)
            if getattr(paho._sock, "pending", lambda: 0)():  # noqa: SLF001
                # Data that is decrypted already does not make the socket readable.
                self._again = self._loop.call_soon(self._read)
        except Exception as error:  # noqa: BLE001  # as in aiomqtt: the connection broke
            if not self._disconnected.done():
                self._disconnected.set_exception(error)

    def _read_one(self, paho: Any) -> MQTTErrorCode:
        """Process the next packet, or read from the socket. Raises: BlockingIOError: the socket is empty."""
        try:
            packet = self._packets.next()
        except (TooLarge, WrongTopic) as error:
            self._on_dropped(error)
        except BrokerFaultError:
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        else:
            if isinstance(packet, Arrived):
                self._arrived(packet)
            elif packet is not None:
                return _parsed(paho, packet)
            else:
                try:
                    data = paho._sock_recv(READ_BYTES)  # noqa: SLF001
                except BlockingIOError:
                    raise
                except OSError:
                    data = b""
                if not data:
                    return MQTTErrorCode.MQTT_ERR_CONN_LOST
                paho._last_bytes_received = time.monotonic()  # noqa: SLF001  # for paho's keep-alive
                self._packets.add(data)
        return MQTTErrorCode.MQTT_ERR_SUCCESS


def _parsed(paho: Any, packet: Answer) -> MQTTErrorCode:
    """Let paho parse a packet, by replacing its read buffer for the time of the call."""
    empty = paho._in_packet  # noqa: SLF001
    try:
        paho._in_packet = empty | {  # noqa: SLF001
            "command": packet.first,
            "have_remaining": 1,
            "remaining_length": len(packet.body),
            "packet": packet.body,
        }
        code: MQTTErrorCode = paho._packet_handle()  # noqa: SLF001
    except MalformedPacket:
        return MQTTErrorCode.MQTT_ERR_PROTOCOL
    finally:
        paho._in_packet = empty  # noqa: SLF001
    return code
