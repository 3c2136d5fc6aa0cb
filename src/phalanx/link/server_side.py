"""Server side of the link in mode qrkey, without I/O: bytes and a time in, events and broker requests out.

`phalanx.net.server` does the I/O and calls this class. Another mode is another class with the same methods.

Source: Qrkey §III; docs/spec/link.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from phalanx.config import LinkConfig
from phalanx.crypto import IV_BYTES
from phalanx.errors import BadPayload, PeerError, WrongTopic

from .envelope import Envelope, encode_pin_message, encode_to_send, open_envelope, seal
from .messages import Ask, Command, Knock, Publish, Rejected, Request, SharedAnswer, Subscribe, Unsubscribe
from .pin import Epoch, Pin, derive_epoch, new_pin
from .replay import ReplayCache
from .rotation import Act, Event, State, step
from .topics import CLIENT_ID, CommandTopic, ReplyTopic, SubTopic, command_filter, full_topic, split_topic


class ServerSide:
    """Epochs, pin rotation, and encryption and decryption of messages. Without `pin` it begins with a random one.

    `random_bytes` returns n bytes from a cryptographic source. `uptime_s` is a monotonic clock, which times the
    rotation.
    """

    def __init__(
        self, config: LinkConfig, random_bytes: Callable[[int], bytes], uptime_s: float, pin: Pin | None = None
    ) -> None:
        self.config = config
        self.state = State.FIRST
        self.rejected: Counter[str] = Counter()
        self._random_bytes = random_bytes
        self._cache = ReplayCache(config.replay_capacity, config.tolerance_s)
        self.epoch = derive_epoch(pin or new_pin(config.pin_digits, random_bytes))  # the pin in the QR code
        self._old: Epoch | None = None
        self.rotated_at_s = uptime_s  # when the current epoch began
        self._knocked_at_s = -config.knock_gap_s

    def live_epochs(self) -> tuple[Epoch, ...]:
        """Return the epochs under which messages are accepted and published, the current one first."""
        return (self.epoch, self._old) if self.state is State.OVERLAP and self._old else (self.epoch,)

    def subscriptions(self) -> tuple[str, ...]:
        """Return all filters to subscribe to now; a broker forgets them when the connection is lost."""
        filters = [f for epoch in self.live_epochs() for f in self._filters(epoch)]
        if self.state is State.SETTLED and self._old:
            filters.append(full_topic(self.config.root, self._old.topic, "request"))
        return tuple(filters)

    def receive(self, topic: str, token: bytes, now_s: float, uptime_s: float) -> Command | Request | Knock | Rejected:
        """Open a message from the broker. Never raises: a refused message is counted."""
        try:
            return self._receive(topic, token, now_s, uptime_s)
        except PeerError as error:
            return self.reject(error)

    def reject(self, error: PeerError) -> Rejected:
        """Count a message that was refused, here or by its handler."""
        self.rejected[error.reason] += 1
        return Rejected(error)

    def notify(self, payload: Any, now_s: float) -> tuple[Publish, ...]:
        """Seal a notification for each live epoch. Raises: UsageError: not JSON, or longer than clients accept."""
        return self._sealed("notify", self._plaintext(payload, now_s))

    def reply(self, request: Request, data: Any, now_s: float) -> tuple[Publish, ...]:
        """Seal the answer to `request` for each live epoch: the visitor may be moving from one to the next.

        A `SharedAnswer` is encoded once for each request number.

        Raises: UsageError: the data is not JSON, or longer than clients accept.
        Source: docs/spec/link.md.
        """
        shared = data if isinstance(data, SharedAnswer) else SharedAnswer(data)
        plaintext = shared.plaintexts.get(request.number)
        if plaintext is None:
            plaintext = self._plaintext({"request": request.number, "data": shared.data}, now_s)
            shared.plaintexts[request.number] = plaintext
        return self._sealed(ReplyTopic(request.client_id), plaintext)

    def advance(self, uptime_s: float) -> tuple[Ask, ...]:
        """Rotate the pin, or end an overlap, if it is due."""
        config = self.config
        since_s = uptime_s - self.rotated_at_s
        asks: tuple[Ask, ...] = ()
        if self.state is State.OVERLAP and since_s >= config.overlap_s:
            asks += self._step(Event.OVERLAP_OVER, uptime_s)
        if since_s >= config.rotate_s:
            asks += self._step(Event.ROTATE_DUE, uptime_s)
        return asks

    def rotate(self, uptime_s: float) -> tuple[Ask, ...]:
        """Rotate early; does nothing in an overlap, because a sleeping phone could miss both rotations."""
        return () if self.state is State.OVERLAP else self._step(Event.ROTATE_DUE, uptime_s)

    def restart_clock(self, uptime_s: float) -> None:
        """Restart the current epoch's time; for a server that was not reachable before."""
        self.rotated_at_s = uptime_s

    def next_due_s(self) -> float:
        """Return the uptime at which `advance` is due next."""
        wait = self.config.overlap_s if self.state is State.OVERLAP else self.config.rotate_s
        return self.rotated_at_s + wait

    def reconnected(self, uptime_s: float) -> tuple[Ask, ...]:
        """Return the messages to repeat after the connection to the broker was lost."""
        return self._step(Event.RECONNECTED, uptime_s)

    def _receive(self, topic: str, token: bytes, now_s: float, uptime_s: float) -> Command | Request | Knock:
        epoch, sub = self._locate(topic)
        opened = open_envelope(token, epoch, now_s, self._cache, self.config.max_to_server_bytes)
        assert isinstance(opened, Envelope)
        if epoch not in self.live_epochs():
            return self._knock(uptime_s)
        if isinstance(sub, CommandTopic):
            return Command(sub, opened.payload)
        return _parse_request(opened.payload, len(token))

    def _locate(self, topic: str) -> tuple[Epoch, SubTopic]:
        known = (self.epoch, self._old) if self._old else (self.epoch,)
        for epoch in known:
            if f"/{epoch.topic}/" in topic:
                sub = split_topic(self.config.root, epoch.topic, topic)
                if sub == "request" or (isinstance(sub, CommandTopic) and epoch in self.live_epochs()):
                    return epoch, sub
        raise WrongTopic("not a topic that a server reads")

    def _knock(self, uptime_s: float) -> Knock:
        if uptime_s - self._knocked_at_s < self.config.knock_gap_s:
            return Knock(())
        self._knocked_at_s = uptime_s
        return Knock(self._step(Event.KNOCK, uptime_s))

    def _step(self, event: Event, uptime_s: float) -> tuple[Ask, ...]:
        self.state, acts = step(self.state, event)
        return tuple(ask for act in acts for ask in self._act(act, uptime_s))

    def _act(self, act: Act, uptime_s: float) -> list[Ask]:
        if act is Act.NEW_EPOCH:
            self._old, self.epoch = self.epoch, self._fresh_epoch()
            self.rotated_at_s = uptime_s
            return [Subscribe(f) for f in self._filters(self.epoch)]
        if self._old is None:  # cannot happen: the table leaves FIRST only by NEW_EPOCH
            return []
        request = full_topic(self.config.root, self._old.topic, "request")
        if act is Act.SEND_PIN:
            token = seal(encode_pin_message(self.epoch.pin), self._old, self._random_bytes(IV_BYTES))
            return [Publish(full_topic(self.config.root, self._old.topic, "notify"), token)]
        if act is Act.DROP_OLD:
            return [Unsubscribe(f) for f in self._filters(self._old) if f != request]
        self._old = None
        return [Unsubscribe(request)]

    def _fresh_epoch(self) -> Epoch:
        taken = {self.epoch.topic, self._old.topic if self._old else ""}
        while (epoch := derive_epoch(new_pin(self.config.pin_digits, self._random_bytes))).topic in taken:
            pass
        return epoch

    def _filters(self, epoch: Epoch) -> tuple[str, ...]:
        root = self.config.root
        return command_filter(root, epoch.topic), full_topic(root, epoch.topic, "request")

    def _plaintext(self, payload: Any, now_s: float) -> bytes:
        return encode_to_send(payload, now_s, self.config.max_to_client_bytes, "clients")

    def _sealed(self, sub: SubTopic, plaintext: bytes) -> tuple[Publish, ...]:
        return tuple(
            Publish(
                full_topic(self.config.root, epoch.topic, sub), seal(plaintext, epoch, self._random_bytes(IV_BYTES))
            )
            for epoch in self.live_epochs()
        )


def _parse_request(payload: Any, size: int) -> Request:
    if not isinstance(payload, dict):
        raise BadPayload("a request must be an object")
    number, client_id = payload.get("request"), payload.get("reply")
    if isinstance(number, bool) or not isinstance(number, int) or abs(number) >= 1 << 53:
        raise BadPayload("'request' is not an integer below 2^53")
    if not isinstance(client_id, str) or not CLIENT_ID.fullmatch(client_id):
        raise BadPayload("'reply' is not a client id")
    return Request(number, client_id, payload, size)
