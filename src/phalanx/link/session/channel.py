"""Encryption of a session's records at one end: sealed with the newest keys, opened with those of two generations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from phalanx.errors import NotAuthentic, UsageError
from phalanx.wire.sessions import RECORD, RECORD_HEAD, TAG_BYTES

from .noise import Cipher, Keys
from .padding import check_size, pad, unpad
from .window import COUNTER_LIMIT, Window

GENERATIONS = 256


@dataclass(slots=True)
class _Generation:
    number: int
    send: Cipher
    receive: Cipher
    made_ms: int
    sent: int = 0
    window: Window = field(default_factory=Window)
    until_ms: int | None = None  # end of receiving with these keys


class Opened(NamedTuple):
    """An opened message of the peer."""

    content: bytes
    is_first: bool  # first with the offered keys, which are in use now
    in_order: bool  # newer than all records opened before


class Channel:
    """Keys and counters of one end of a session.

    A server `offers` keys when it answers a handshake; they take effect with the first record that they open. A client
    `adopts` keys when it reads that answer, and sends with them at once.
    """

    __slots__ = ("_before", "_max_receive", "_max_send", "_now", "_offered", "_overlap_ms", "is_server")

    def __init__(self, *, is_server: bool, max_receive_bytes: int, max_send_bytes: int, overlap_ms: int) -> None:
        self.is_server = is_server
        self._max_receive, self._max_send, self._overlap_ms = max_receive_bytes, max_send_bytes, overlap_ms
        self._now: _Generation | None = None  # in use
        self._before: _Generation | None = None
        self._offered: _Generation | None = None

    @property
    def is_open(self) -> bool:
        """Return whether keys are in use."""
        return self._now is not None

    @property
    def made_ms(self) -> int:
        """Return the time at which the keys in use were made; 0 without keys."""
        return self._now.made_ms if self._now else 0

    @property
    def next_generation(self) -> int:
        """Return the generation number for the keys of the next handshake."""
        return (self._now.number + 1) % GENERATIONS if self._now else 0

    def receive_ciphers(self) -> list[Cipher]:
        """Return the ciphers for receiving; topics on a broker are derived from them."""
        return [each.receive for each in (self._now, self._before, self._offered) if each]

    def send_cipher(self) -> Cipher:
        """Return the cipher for sending. Raises: UsageError: there are no keys yet."""
        return self._used().send

    def offer(self, keys: Keys, now_ms: int) -> None:
        """Accept records with these keys as well; they replace keys that were only offered."""
        self._offered = self._generation(self.next_generation, keys, now_ms)

    def withdraw(self) -> None:
        """Drop offered keys that are not in use yet."""
        self._offered = None

    def adopt(self, number: int, keys: Keys, now_ms: int) -> None:
        """Use these keys from now on; still receive with the old ones until a while after the peer uses the new."""
        self._before, self._now = self._now, self._generation(number, keys, now_ms)

    def expire(self, now_ms: int) -> None:
        """Drop the previous keys if their time is over."""
        if self._before and self._before.until_ms is not None and now_ms >= self._before.until_ms:
            self._before = None

    def seal(self, content: bytes) -> bytes:
        """Encrypt a message as a record. Raises: UsageError: too long, or there are no keys yet."""
        used = self._used()
        plaintext = pad(content, self._max_send)
        if used.sent >= COUNTER_LIMIT:
            raise UsageError("the counter of the session is exhausted", "make new keys")
        head = {"generation": used.number, "counter": used.sent}
        used.sent += 1
        sealed = used.send.seal(head["counter"], plaintext, RECORD_HEAD.encode(**head))
        return RECORD.encode(**head, sealed=sealed)

    def open(self, raw: bytes, now_ms: int) -> Opened:
        """Open a record of the peer.

        Raises: TooLarge, MalformedRecord, NotAuthentic, Replayed.
        """
        check_size(raw, RECORD.size + self._max_receive + TAG_BYTES)
        fields = RECORD.decode(raw)
        self.expire(now_ms)
        number, counter, sealed = fields["generation"], fields["counter"], fields["sealed"]
        known = (self._now, self._before, self._offered)
        used = next((each for each in known if each and each.number == number), None)
        if used is None:
            raise NotAuthentic("the key generation is not in use")
        used.window.check(counter)
        plaintext = used.receive.open(counter, sealed, RECORD_HEAD.encode(generation=number, counter=counter))
        content = unpad(plaintext)
        in_order = used is not self._before and used.window.is_newest(counter)
        used.window.enter(counter)
        is_first = used is self._offered
        if is_first:
            self._before, self._now, self._offered = self._now, used, None
        if used is self._now and self._before and self._before.until_ms is None:
            self._before.until_ms = now_ms + self._overlap_ms
        return Opened(content, is_first, in_order)

    def _generation(self, number: int, keys: Keys, now_ms: int) -> _Generation:
        send, receive = (keys.to_client, keys.to_server) if self.is_server else (keys.to_server, keys.to_client)
        return _Generation(number, send, receive, now_ms)

    def _used(self) -> _Generation:
        if self._now is None:
            raise UsageError("the session has no keys yet")
        return self._now
