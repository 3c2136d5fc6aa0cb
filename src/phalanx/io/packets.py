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

from phalanx.errors import PeerError, TooLarge

from .websocket import Websocket

MAX_PACKET_BYTES = 2 * 1024 * 1024  # above the largest message a client reads: 1 MiB of plaintext, 4/3 of that sealed
MAX_TOPIC_BYTES = 1024  # above the longest topic of ours, under the longest root
MAX_PROPERTIES_BYTES = 256  # nobody here reads any
MAX_ANSWER_BYTES = 512  # of a broker to what we asked of it: paho reads properties in a time that grows with its square
# Other work of this loop waits no longer for packets that come without end; more than enough to empty a socket.
READ_FOR_S = 0.005
READ_BYTES = 64 * 1024
BEAT_S = 0.05
PUBLISH, QOS = 0x30, 0x06


class BrokerFaultError(aiomqtt.MqttError):
    """The broker sent what no broker sends: it is left."""


def check_packet(first: int, length: int, packet: bytes | bytearray, mqtt: int) -> None:
    """Nothing, if a packet of this first byte and this length after it is cheap to parse.

    `packet` is what follows the length, or only its end if it is longer than `MAX_PACKET_BYTES`.

    Raises: TooLarge: a message that is to be dropped. BrokerFaultError.
    Source: MQTT 5.0 §2, §3.3.
    """
    if first & 0xF0 != PUBLISH:
        if length > MAX_ANSWER_BYTES:
            raise BrokerFaultError("an answer of absurd length")
        return
    if length > MAX_PACKET_BYTES:
        raise TooLarge(f"packet of {length} bytes")
    after_topic = 2 + int.from_bytes(packet[:2], "big")
    if first & QOS or after_topic > length:  # nothing but QoS 0 is subscribed to; more would be kept until it ends
        raise BrokerFaultError("not what was subscribed to")
    if after_topic > MAX_TOPIC_BYTES:
        raise TooLarge(f"topic of {after_topic} bytes")
    if mqtt == 5 and _varint(packet[after_topic : after_topic + 4]) > MAX_PROPERTIES_BYTES:
        raise TooLarge("properties that nobody reads")


def _varint(encoded: bytes | bytearray) -> int:
    value = 0
    for i, byte in enumerate(encoded):
        value |= (byte & 127) << 7 * i
        if byte < 128:
            return value
    raise BrokerFaultError("a length without an end")


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
        self._websocket = Websocket(server=False)
        self._carried = bytearray()
        self._at = 0
        self.is_dry = True  # the last that was read was all there was
        self._pending = sock.pending
        sock.recv, sock.pending = self.recv, self.pending

    def recv(self, length: int) -> bytes:
        """At most so many bytes; b"" at the end.

        Raises: BlockingIOError: there are none now, or some frames that carry nothing were read: there may be more.
        """
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
    """aiomqtt's client, but every packet is checked first.

    `on_dropped` is called for every message that is dropped unparsed; `emptied` is told when the socket is empty.
    """

    def __init__(self, *where: Any, on_dropped: Callable[[PeerError], None], emptied: Emptied, **more: Any) -> None:
        super().__init__(*where, **more)
        self._is_websocket = more.get("transport") == "websockets"
        self._on_dropped = on_dropped
        self._emptied = emptied
        self._again: asyncio.Handle | None = None
        self._frames: Frames | None = None
        paho: Any = self._client
        # A broker can send a topic that aiomqtt raises on. Unsuppressed, paho would read the same packet again for
        # ever, and log it each time, escape sequences included.
        paho.suppress_exceptions = True
        self._parse, paho._packet_handle = paho._packet_handle, self._check_and_parse  # noqa: SLF001
        self._dial, paho._create_socket_connection = paho._create_socket_connection, self._dialled  # noqa: SLF001
        self._way: socket.socket | None = None
        # It asks for all that is missing of a packet at once, a hundred times a turn: tens of megabytes.
        receive = paho._sock_recv  # noqa: SLF001
        paho._sock_recv = lambda length: receive(min(length, READ_BYTES))  # noqa: SLF001

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

    def _check_and_parse(self) -> MQTTErrorCode:
        paho: Any = self._client
        said, version = paho._in_packet, 5 if paho._protocol == aiomqtt.ProtocolVersion.V5 else 4  # noqa: SLF001
        try:
            check_packet(said["command"], said["remaining_length"], said["packet"], version)
        except TooLarge as error:
            self._on_dropped(error)
            return MQTTErrorCode.MQTT_ERR_SUCCESS
        except BrokerFaultError:
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        code: MQTTErrorCode = self._parse()
        return code

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
                code = paho._packet_read()  # noqa: SLF001
                if code == MQTTErrorCode.MQTT_ERR_AGAIN:
                    if paho._in_packet["remaining_length"] > MAX_PACKET_BYTES:  # noqa: SLF001
                        paho._in_packet["packet"].clear()  # noqa: SLF001  # will be dropped: nothing of it is kept
                    self._emptied.read(empty=self._frames is None or self._frames.is_dry)
                    self._read_again()
                    return
                if code > 0:
                    paho._loop_rc_handle(code)  # noqa: SLF001
                    return
            self._emptied.read(empty=False)
            self._read_again()
        except Exception as error:  # noqa: BLE001  # as in aiomqtt: the connection broke
            if not self._disconnected.done():
                self._disconnected.set_exception(error)

    def _read_again(self) -> None:
        paho: Any = self._client
        if getattr(paho._sock, "pending", lambda: 0)():  # noqa: SLF001
            # Decrypted already, or read already: the loop does not see it on the socket.
            self._again = self._loop.call_soon(self._read)
