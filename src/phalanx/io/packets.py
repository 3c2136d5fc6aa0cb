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
from .websocket import Websocket

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


class Frames:
    """What a websocket of paho's reads, in a time that grows with its length.

    paho copies all that it has of a frame for every piece that it takes of it: a frame of a megabyte in which a broker
    puts many small packets holds it up for minutes. And it answers pings unmasked, and is hung up on for it.
    """

    def __init__(self, sock: Any) -> None:
        self._socket = sock._socket  # noqa: SLF001
        self._websocket = Websocket()
        self._carried = bytearray()
        self._at = 0
        self.is_dry = True  # the last that was read was all there was
        self._pending = sock.pending
        sock.recv, sock.pending = self.recv, self.pending

    def recv(self, length: int) -> bytes:
        """Return at most so many bytes; b"" at the end. Raises: BlockingIOError: none now, or only empty frames."""
        if self._at == len(self._carried):
            self.is_dry = False
            if self._websocket.closed or not self._read():
                return b""
            if not self._carried:
                raise BlockingIOError
        piece = bytes(self._carried[self._at : self._at + length])
        self._at += len(piece)
        return piece

    def _read(self) -> bool:
        """A few frames; whether the other end is still there. Raises: BlockingIOError: there are none now."""
        try:
            data = b"" if self._websocket.has_more else self._socket.recv(READ_BYTES)
            if not (data or self._websocket.has_more):
                return False
            self._carried, self._at = bytearray(self._websocket.read(data)), 0
            if self._websocket.replies:
                self._socket.send(self._websocket.replies)
                self._websocket.replies = b""
        except BlockingIOError:
            self.is_dry = True
            raise
        except (ConnectionError, PeerError):
            return False
        return True

    def pending(self) -> int:
        """Bytes that were taken from the socket already."""
        waiting: int = len(self._carried) - self._at + self._websocket.has_more + self._pending()
        return waiting


class CheckedClient(aiomqtt.Client):
    """aiomqtt's client, but it reads by itself: a message never comes to paho, and what does is cheap to parse.

    paho asks the system three times for each packet, and takes 60 µs for it; other threads have their turn at each.

    `arrived` takes the messages, `on_dropped` is told of every one that is dropped, `emptied` when the socket is empty.
    """

    def __init__(
        self,
        *where: Any,
        arrived: Callable[[Arrived], None],
        on_dropped: Callable[[PeerError], object],
        emptied: Emptied,
        **more: Any,
    ) -> None:
        super().__init__(*where, **more)
        self._is_websocket = more.get("transport") == "websockets"
        self._arrived, self._on_dropped = arrived, on_dropped
        self._emptied = emptied
        self._again: asyncio.Handle | None = None
        self._frames: Frames | None = None
        paho: Any = self._client
        self._packets = BrokerPackets(5 if paho._protocol == aiomqtt.ProtocolVersion.V5 else 4)  # noqa: SLF001
        # Or what aiomqtt raises on would end this loop.
        paho.suppress_exceptions = True
        self._dial, paho._create_socket_connection = paho._create_socket_connection, self._dialled  # noqa: SLF001
        self._way: socket.socket | None = None

    async def __aenter__(self) -> Self:
        # paho connects in a thread that nothing can stop, and waits anew for each byte of a websocket's answer:
        # whatever happens here, it has no way left then.
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
        way: socket.socket = self._dial()
        self._way = way.dup()  # TLS takes the other one over
        return way

    def _on_socket_open(self, client: Any, userdata: Any, sock: Any) -> None:
        # Called from the thread that connects. aiomqtt's own reader does not end under TLS while packets come.
        if self._is_websocket:
            self._frames = Frames(sock)
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
            self._emptied.read(empty=self._frames is None or self._frames.is_dry)
            if getattr(paho._sock, "pending", lambda: 0)():  # noqa: SLF001
                # Decrypted already, or read already: the loop does not see it on the socket.
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
