"""An MQTT client that looks at every packet before anything of it is parsed.

paho takes a time that grows with the square of a packet's MQTT 5 properties: 100 000 empty ones, half a megabyte,
stopped a gateway for a minute and a half. So nothing of a packet is parsed before its size and form are known to be
cheap.
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

# Other work of this loop waits no longer for packets that come without end; more than enough to empty a socket.
READ_FOR_S = 0.005
READ_BYTES = 64 * 1024
BEAT_S = 0.05


class Emptied:
    """Since when a message that is read now may have lain in the socket: since that was last known to be empty.

    The kernel does not say when a message came. While this loop is held up, or messages come faster than they are read,
    they wait unseen.
    """

    def __init__(self) -> None:
        self.at_s = self._beat_s = time.monotonic()
        self._empty = True

    def read(self, empty: bool) -> None:
        """Some packets were read, and the socket was `empty` then, or not."""
        self._empty = empty
        if empty:
            self.at_s = time.monotonic()

    async def watch(self) -> None:
        """Know of a socket from which nothing comes that it is empty; runs until cancelled."""
        while True:
            await asyncio.sleep(BEAT_S)
            # Since the last beat the loop has looked at the socket; whatever came before that look has been read by
            # now. How long after that look this line runs is not known.
            if self._empty:
                self.at_s = max(self.at_s, self._beat_s)
            self._beat_s = time.monotonic()


class CheckedClient(aiomqtt.Client):
    """aiomqtt's client, but it reads by itself: a message never comes to paho, and what does is cheap to parse.

    paho asks the system three times for each packet, and takes 60 µs for it; other threads have their turn at each.

    `way` is a socket by which the broker is reached already, if it is. `arrived` takes the messages, `on_dropped` is
    told of every one that is dropped, `emptied` when the socket is empty.
    """

    def __init__(
        self,
        *where: Any,
        way: socket.socket | None,
        arrived: Callable[[Arrived], None],
        on_dropped: Callable[[PeerError], object],
        emptied: Emptied,
        **more: Any,
    ) -> None:
        super().__init__(*where, **more)
        self._arrived, self._on_dropped = arrived, on_dropped
        self._emptied = emptied
        self._again: asyncio.Handle | None = None
        paho: Any = self._client
        self._packets = BrokerPackets(5 if paho._protocol == aiomqtt.ProtocolVersion.V5 else 4)  # noqa: SLF001
        # Or what aiomqtt raises on would end this loop.
        paho.suppress_exceptions = True
        self._dial, paho._create_socket_connection = paho._create_socket_connection, self._dialled  # noqa: SLF001
        self._way = way

    async def __aenter__(self) -> Self:
        # paho connects in a thread that nothing can stop: whatever happens here, it has no way left then.
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
        self._way = way.dup()  # TLS takes the other one over
        return way

    def _on_socket_open(self, client: Any, userdata: Any, sock: Any) -> None:
        # Called from the thread that connects. aiomqtt's own reader does not end under TLS while packets come.
        super()._on_socket_open(client, userdata, sock)
        self._loop.call_soon_threadsafe(self._loop.add_reader, sock.fileno(), self._read)

    def _read(self) -> None:
        """Read packets until the socket is empty, or for `READ_FOR_S`."""
        paho: Any = self._client
        until_s = time.monotonic() + READ_FOR_S
        if self._again:  # or there would be one more of these in every turn of the loop that finds the socket readable
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
                # Decrypted already: the loop does not see it on the socket.
                self._again = self._loop.call_soon(self._read)
        except Exception as error:  # noqa: BLE001  # as in aiomqtt: the connection broke
            if not self._disconnected.done():
                self._disconnected.set_exception(error)

    def _read_one(self, paho: Any) -> MQTTErrorCode:
        """A packet that has come, or more of the stream. Raises: BlockingIOError: there is none now."""
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
                paho._last_bytes_received = time.monotonic()  # noqa: SLF001  # or it would ask whether we are there
                self._packets.add(data)
        return MQTTErrorCode.MQTT_ERR_SUCCESS


def _parsed(paho: Any, packet: Answer) -> MQTTErrorCode:
    """Paho has what it keeps while it reads one, and gets it back as it was."""
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
