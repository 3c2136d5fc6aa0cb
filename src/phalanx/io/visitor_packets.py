"""What a visitor may send to a broker of ours, packet by packet: nothing that the broker would keep or that costs much.

Source: MQTT 3.1.1 and 5.0, §2 and §3.
"""

from __future__ import annotations

from phalanx.errors import PeerError, TooLarge

CONNECT, PUBLISH, SUBSCRIBE, UNSUBSCRIBE, PINGREQ, DISCONNECT = 0x10, 0x30, 0x82, 0xA2, 0xC0, 0xE0
# Above the longest message that a server reads: 48 KiB of plaintext, 4/3 of that sealed, and its topic.
LONGEST = {CONNECT: 2048, PUBLISH: 80 * 1024, SUBSCRIBE: 2048, UNSUBSCRIBE: 2048}
LONGEST_OTHER = 128
# A visitor has two, and two more while it follows a rotation.
SUBSCRIPTIONS = 8
# mosquitto 2.0.11 keeps 31 bytes for ever of each filter that a session has already: so often that may be, no more.
REPEATED = 8
FILTER_BYTES, FILTER_LEVELS = 1024, 16
OTHERS = (PINGREQ, DISCONNECT)
VERSIONS = ((b"MQTT", 5), (b"MQTT", 4), (b"MQIsdp", 3))
QOS = 0x06
CLEAN, WILL, SESSION_EXPIRY = 0x02, 0x04, 0x11
MAX_KEEPALIVE_S = 120
# How long a property of CONNECT is, by its id; a negative one begins with so many strings' lengths.
_PROPERTIES = {SESSION_EXPIRY: 4, 0x21: 2, 0x22: 2, 0x27: 4, 0x19: 1, 0x17: 1, 0x26: -2, 0x15: -1, 0x16: -1}
NOT_ITS_OWN = b"\xff\xff"  # a packet's number: clients count from 1
NONE = b"\x00"  # properties: nobody here reads any, and mosquitto 2.0.11 counts 56 bytes for each for ever


class NotForVisitorsError(PeerError):
    """No visitor sends that: it is hung up on."""

    reason = "not_for_visitors"


def is_one_topic(name: bytes) -> bool:
    """Whether a filter names one topic, and so nothing of what others are told; not a group's either."""
    return b"+" not in name and b"#" not in name and not name.startswith(b"$")


def is_question(published: bytes) -> bool:
    """Whether this PUBLISH asks the swarm something; whole, as `VisitorPackets` gives it."""
    _, at = varint(published, 1)
    return published[at + 2 : at + 2 + u16(published, at)].endswith(b"/request")


class VisitorPackets:
    """One visitor's stream of MQTT, cut into packets that are whole and may be passed on.

    `client_id` is one that nobody else has, and takes the place of its own: a broker hangs up on whoever had the same.
    """

    def __init__(self, client_id: bytes) -> None:
        self.connected = False
        self._client_id = client_id
        self._mqtt = 4
        self._came = bytearray()
        self._filters: set[bytes] = set()
        self._repeated = 0

    @property
    def answers(self) -> frozenset[bytes]:
        """Topics for answers that it reads."""
        return frozenset(name for name in self._filters if name.rpartition(b"/")[0].endswith(b"/reply"))

    def without(self, name: bytes) -> bytes:
        """What ends its subscription to `name`, said for it; the answer to that is nothing to it."""
        self._filters.discard(name)
        body = NOT_ITS_OWN + (NONE if self._mqtt == 5 else b"") + len(name).to_bytes(2, "big") + name
        return bytes([UNSUBSCRIBE]) + _as_varint(len(body)) + body

    def __len__(self) -> int:
        """Bytes of the stream that are kept: of packets that nobody asked for yet, and of one that is not whole."""
        return len(self._came)

    def add(self, data: bytes) -> None:
        """More of the stream."""
        self._came += data

    def next(self) -> bytes | None:
        """The next packet that is whole, as the broker shall have it; None if there is none yet.

        Raises: NotForVisitorsError. TooLarge.
        """
        came = self._came
        try:
            length, at = varint(came, 1)
            first = came[0]
        except IndexError:
            return None
        kind = PUBLISH if first & 0xF0 == PUBLISH else first
        if kind not in LONGEST and kind not in OTHERS:
            raise NotForVisitorsError("no such packet")
        if length > LONGEST.get(kind, LONGEST_OTHER):
            raise TooLarge(f"packet of {length} bytes")
        if self.connected == (kind == CONNECT):
            raise NotForVisitorsError("CONNECT comes first, and once")
        if len(came) < at + length:
            return None
        packet = came[at : at + length]
        del came[: at + length]
        try:
            self._check(kind, first, packet)
        except IndexError:
            raise NotForVisitorsError("shorter than it says") from None
        return bytes([first]) + _as_varint(len(packet)) + packet

    def _check(self, kind: int, first: int, packet: bytearray) -> None:
        """It becomes what the broker shall have."""
        if kind == CONNECT:
            self._keep_nothing_of(packet)
        elif kind in (SUBSCRIBE, UNSUBSCRIBE):
            self._without_properties(packet, 2)
            self._count(kind, packet)
        elif kind == PUBLISH:
            end = 2 + u16(packet, 0) + (2 if first & QOS else 0)
            self._without_properties(packet, end)
            if end > len(packet):
                raise NotForVisitorsError("a topic that does not end")

    def _without_properties(self, packet: bytearray, at: int) -> None:
        """It has none, where those of MQTT 5 begin."""
        if self._mqtt == 5:
            size, end = varint(packet, at)
            if end + size > len(packet):
                raise NotForVisitorsError("properties that do not end")
            packet[at : end + size] = NONE

    def _keep_nothing_of(self, packet: bytearray) -> None:
        """A CONNECT whose session ends with its connection, whatever was asked for."""
        name = bytes(packet[2 : 2 + u16(packet, 0)])
        at = 2 + len(name)
        self._mqtt = packet[at]
        # Exactly: mosquitto leaves the highest bit out, and would take 0x85 for 5.
        if (name, self._mqtt) not in VERSIONS:
            raise NotForVisitorsError("no such version")
        if packet[at + 1] & WILL:  # a message that would wait for no turn
            raise NotForVisitorsError("a will")
        packet[at + 1] |= CLEAN
        self.connected = True
        at += 4
        if self._mqtt == 5:
            at = self._keep_few(packet, at)
        elif not 0 < u16(packet, at - 2) <= MAX_KEEPALIVE_S:  # by MQTT 5 the broker says how long
            packet[at - 2 : at] = MAX_KEEPALIVE_S.to_bytes(2, "big")
        if size := u16(packet, at):  # by MQTT 5, whoever says none is told
            packet[at : at + 2 + size] = len(self._client_id).to_bytes(2, "big") + self._client_id

    def _keep_few(self, packet: bytearray, begin: int) -> int:
        """Where the properties end that begin there: what it can take, once each; the session ends without a word."""
        size, at = varint(packet, begin)
        end = at + size
        kept: dict[int, bytes] = {}
        while at < end:
            kind, at = packet[at], at + 1
            size = _PROPERTIES.get(kind, 0)
            if not size:
                raise NotForVisitorsError("no such property")
            for _ in range(-size):
                at += 2 + u16(packet, at)
            if size > 0 and kind != SESSION_EXPIRY:
                kept[kind] = bytes(packet[at - 1 : at + size])
            at += max(size, 0)
        if at != end or end > len(packet):
            raise NotForVisitorsError("properties that do not end")
        packet[begin:end] = _as_varint(sum(map(len, kept.values()))) + b"".join(kept.values())
        return begin + 1 + packet[begin]

    def _count(self, kind: int, body: bytearray) -> None:
        at, named = 2 + (self._mqtt == 5), 0
        while at < len(body):
            named += 1
            end = at + 2 + u16(body, at)
            name = bytes(body[at + 2 : end])
            if len(name) > FILTER_BYTES or name.count(b"/") >= FILTER_LEVELS:
                raise NotForVisitorsError("a filter like none of ours")
            if kind == SUBSCRIBE:
                if not is_one_topic(name):
                    raise NotForVisitorsError("what is for others")
                self._repeated += name in self._filters
                self._filters.add(name)
                end += 1
            else:
                self._filters.discard(name)
            at = end
        if at != len(body):
            raise NotForVisitorsError("shorter than it says")
        if max(named, len(self._filters)) > SUBSCRIPTIONS or self._repeated > REPEATED:
            raise NotForVisitorsError("subscriptions without end")


def u16(data: bytes | bytearray, at: int) -> int:
    """The number of two bytes there. Raises: IndexError: they are not there."""
    return data[at] << 8 | data[at + 1]


def varint(data: bytes | bytearray, at: int) -> tuple[int, int]:
    """The number there of one to four bytes, and where it ends.

    Raises: IndexError: they are not there. NotForVisitorsError: it is longer.
    """
    value = 0
    for shift in range(0, 28, 7):
        value |= (data[at] & 127) << shift
        at += 1
        if data[at - 1] < 128:
            return value, at
    raise NotForVisitorsError("a length without an end")


def _as_varint(value: int) -> bytes:
    """For up to 2 097 151."""
    if value < 128:
        return bytes([value])
    high = value >> 7
    return bytes([value & 127 | 128]) + (bytes([high]) if high < 128 else bytes([high & 127 | 128, high >> 7]))
