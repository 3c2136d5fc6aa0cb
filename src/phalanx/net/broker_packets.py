"""What a broker sends, packet by packet: nothing that is dear to hold or to parse.

Source: MQTT 3.1.1 and 5.0, §2 and §3.3.
"""

from __future__ import annotations

from typing import NamedTuple

import aiomqtt

from phalanx.errors import TooLarge, WrongTopic

MAX_PACKET_BYTES = 2 * 1024 * 1024  # above the largest message a client reads: 1 MiB of plaintext, 4/3 of that sealed
MAX_TOPIC_BYTES = 1024  # above the longest topic of ours, under the longest root
MAX_PROPERTIES_BYTES = 256  # nobody here reads any
MAX_ANSWER_BYTES = 512  # of a broker to what we asked of it: paho reads properties in a time that grows with its square
PUBLISH, QOS = 0x30, 0x06


class BrokerFaultError(aiomqtt.MqttError):
    """The broker sent what no broker sends: it is left."""


class Arrived(NamedTuple):
    """A message."""

    topic: str
    payload: bytes

    @property
    def size(self) -> int:
        """Bytes that it takes."""
        return len(self.topic) + len(self.payload)


class Answer(NamedTuple):
    """Any other packet: its first byte, and what follows its length."""

    first: int
    body: bytearray


class BrokerPackets:
    """One connection's stream, cut; of a version of MQTT, 5 or 4."""

    def __init__(self, mqtt: int) -> None:
        self._mqtt = mqtt
        self._came = bytearray()
        self._at = 0  # what is before that is done with
        self._skip = 0  # bytes to come of a message that is dropped

    def add(self, data: bytes) -> None:
        """More of the stream. What was not cut yet is copied: cut all of it before."""
        del self._came[: self._at]
        self._at = 0
        skipped = min(self._skip, len(data))
        self._skip -= skipped
        self._came += data[skipped:] if skipped else data

    def next(self) -> Arrived | Answer | None:
        """Return the next whole packet, if any. Raises: TooLarge, WrongTopic: one is dropped; BrokerFaultError."""
        came, at = self._came, self._at
        body = self._body(at)
        if body is None:
            return None
        begin, length = body
        first, end = came[at], begin + length
        if first & 0xF0 != PUBLISH:
            if length > MAX_ANSWER_BYTES:
                raise BrokerFaultError("an answer of absurd length")
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
        """Where it begins, and how long it is; None as long as that has not come."""
        length = 0
        for i in range(4):
            if at + 1 + i >= len(self._came):
                return None
            byte = self._came[at + 1 + i]
            length |= (byte & 127) << 7 * i
            if byte < 128:
                return at + 2 + i, length
        raise BrokerFaultError("a length without an end")

    def _message(self, first: int, begin: int, end: int) -> Arrived:
        came = self._came
        topic_end = begin + 2 + int.from_bytes(came[begin : begin + 2], "big")
        if first & QOS or topic_end > end:  # nothing but QoS 0 is subscribed to; more would be kept until it ends
            raise BrokerFaultError("not what was subscribed to")
        if topic_end - begin > MAX_TOPIC_BYTES:
            raise TooLarge(f"topic of {topic_end - begin} bytes")
        payload = topic_end
        if self._mqtt == 5:
            body = self._body(topic_end - 1) if topic_end < end else None
            if body is None or sum(body) > end:
                raise BrokerFaultError("properties that do not end")
            if body[1] > MAX_PROPERTIES_BYTES:
                raise TooLarge("properties that nobody reads")
            payload = sum(body)
        try:
            topic = came[begin + 2 : topic_end].decode()
        except UnicodeDecodeError:
            raise WrongTopic("not UTF-8") from None
        return Arrived(topic, bytes(memoryview(came)[payload:end]))
