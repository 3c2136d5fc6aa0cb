"""Splitting of a broker's byte stream into MQTT packets; packets that are expensive to hold or to parse are dropped.

Source: MQTT 3.1.1 and 5.0, §2 and §3.3.
"""

from __future__ import annotations

from typing import NamedTuple

import aiomqtt

from phalanx.errors import TooLarge, WrongTopic

MAX_PACKET_BYTES = 2 * 1024 * 1024  # above the largest message to a client: 1 MiB of plaintext, 4/3 of that sealed
MAX_TOPIC_BYTES = 1024  # above the longest topic of phalanx under the longest root
MAX_PROPERTIES_BYTES = 256  # properties are not used
MAX_ANSWER_BYTES = 512  # limit of other packets: paho's time for properties grows with the square of their number
PUBLISH, QOS = 0x30, 0x06


class BrokerFaultError(aiomqtt.MqttError):
    """The broker violated the protocol; the connection is closed."""


class Arrived(NamedTuple):
    """Message that the broker delivered."""

    topic: str
    payload: bytes

    @property
    def size(self) -> int:
        """Return the size of topic and payload, bytes."""
        return len(self.topic) + len(self.payload)


class Answer(NamedTuple):
    """Packet other than PUBLISH: its first byte, and the bytes after its length."""

    first: int
    body: bytearray


class BrokerPackets:
    """Packets of one connection's stream, for MQTT version 5 or 4."""

    def __init__(self, mqtt: int) -> None:
        self._mqtt = mqtt
        self._came = bytearray()
        self._at = 0  # offset of the first unprocessed byte
        self._skip = 0  # bytes still to come of a message that is dropped

    def add(self, data: bytes) -> None:
        """Append bytes of the stream. Call `next` until it returns None before, as unprocessed bytes are copied."""
        del self._came[: self._at]
        self._at = 0
        skipped = min(self._skip, len(data))
        self._skip -= skipped
        self._came += data[skipped:] if skipped else data

    def next(self) -> Arrived | Answer | None:
        """Return the next complete packet, if any. Raises: TooLarge, WrongTopic: it was dropped; BrokerFaultError."""
        came, at = self._came, self._at
        body = self._body(at)
        if body is None:
            return None
        begin, length = body
        first, end = came[at], begin + length
        if first & 0xF0 != PUBLISH:
            if length > MAX_ANSWER_BYTES:
                raise BrokerFaultError(f"packet of type {first >> 4} with {length} bytes")
            if end > len(came):
                return None
            self._at = end
            return Answer(first, came[begin:end])
        if length > MAX_PACKET_BYTES:
            self._skip, self._at = max(0, end - len(came)), min(end, len(came))
            raise TooLarge(f"packet of {length} bytes")
        if end > len(came):
            return None
        self._at = end
        return self._message(first, begin, end)

    def _body(self, at: int) -> tuple[int, int] | None:
        """Return the offset and the length of the body after a length field; None if that is incomplete."""
        length = 0
        for i in range(4):
            if at + 1 + i >= len(self._came):
                return None
            byte = self._came[at + 1 + i]
            length |= (byte & 127) << 7 * i
            if byte < 128:
                return at + 2 + i, length
        raise BrokerFaultError("malformed length")

    def _message(self, first: int, begin: int, end: int) -> Arrived:
        came = self._came
        topic_end = begin + 2 + int.from_bytes(came[begin : begin + 2], "big")
        if first & QOS or topic_end > end:  # subscriptions have QoS 0; paho would keep messages of a higher one
            raise BrokerFaultError("malformed PUBLISH, or QoS above 0")
        if topic_end - begin > MAX_TOPIC_BYTES:
            raise TooLarge(f"topic of {topic_end - begin} bytes")
        payload = topic_end
        if self._mqtt == 5:
            body = self._body(topic_end - 1) if topic_end < end else None
            if body is None or sum(body) > end:
                raise BrokerFaultError("malformed properties")
            if body[1] > MAX_PROPERTIES_BYTES:
                raise TooLarge(f"properties of {body[1]} bytes")
            payload = sum(body)
        try:
            topic = came[begin + 2 : topic_end].decode()
        except UnicodeDecodeError:
            raise WrongTopic("topic is not UTF-8") from None
        return Arrived(topic, bytes(memoryview(came)[payload:end]))
