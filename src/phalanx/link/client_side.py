"""Client side of the link in mode qrkey, without I/O: bytes and a time in, events and broker requests out.

Source: Qrkey §III, Table I; docs/spec/link.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from phalanx.config import LinkConfig
from phalanx.crypto import IV_BYTES
from phalanx.errors import BadPayload, PeerError, UsageError, WrongTopic

from .envelope import encode_to_send, open_envelope, seal
from .messages import Moved, Notification, Publish, Rejected, Reply, Subscribe, Unsubscribe
from .pin import Epoch, Pin, derive_epoch
from .replay import ReplayCache
from .topics import CommandTopic, ReplyTopic, SubTopic, full_topic, split_topic


class ClientSide:
    """State of one client: its epoch, and encryption and decryption of messages. The pin is from the QR code.

    `random_bytes` returns n bytes from a cryptographic source. `client_id` names the topic for answers; it is not a
    secret, and authenticates nobody.

    Raises: UsageError: the client id has characters that are not allowed in a topic.
    """

    def __init__(self, config: LinkConfig, random_bytes: Callable[[int], bytes], pin: Pin, client_id: str) -> None:
        try:
            self._reply = ReplyTopic(client_id)
        except WrongTopic as error:
            raise UsageError(str(error), "use only letters, digits and _.:-") from error
        self.config = config
        self.client_id = client_id
        self.rejected: Counter[str] = Counter()
        self._random_bytes = random_bytes
        self._cache = ReplayCache(config.replay_capacity, config.tolerance_s)
        self.epoch = derive_epoch(pin)
        self._left: Epoch | None = None  # last epoch with a received message, until one arrives in the current epoch

    def subscriptions(self) -> tuple[str, ...]:
        """Return all topics to subscribe to now."""
        root, topic = self.config.root, self.epoch.topic
        return full_topic(root, topic, "notify"), full_topic(root, topic, self._reply)

    def receive(self, topic: str, token: bytes, now_s: float) -> Notification | Reply | Moved | Rejected:
        """Open a message from the broker. Never raises: a refused message is counted."""
        try:
            return self._receive(topic, token, now_s)
        except PeerError as error:
            return self.reject(error)

    def reject(self, error: PeerError) -> Rejected:
        """Count a message that was refused, here or by the caller."""
        self.rejected[error.reason] += 1
        return Rejected(error)

    def command(self, to: CommandTopic, payload: Any, now_s: float) -> Publish:
        """Seal a command for one robot. Raises: UsageError: not JSON, or longer than servers accept."""
        return self._publish(to, payload, now_s)

    def request(self, number: int, now_s: float, **words: Any) -> Publish:
        """Seal a request; its `Reply` has the same number. Raises: UsageError: longer than servers accept."""
        return self._publish("request", {"request": number, "reply": self.client_id, **words}, now_s)

    def fall_back(self, asked: Epoch) -> Moved | None:
        """Return to the last epoch after an unanswered request in epoch `asked`, unless a message has arrived in it.

        The pin message that led to this epoch may be forged. If it was genuine, the server sends it again.
        """
        if self._left is None or asked is not self.epoch:
            return None
        epoch, self._left = self._left, None
        return self._go(epoch)

    def _receive(self, topic: str, token: bytes, now_s: float) -> Notification | Reply | Moved:
        sub = split_topic(self.config.root, self.epoch.topic, topic)
        if sub not in ("notify", self._reply):
            raise WrongTopic("not a topic that this client reads")
        opened = open_envelope(
            token,
            self.epoch,
            now_s,
            self._cache,
            self.config.max_to_client_bytes,
            pin_message_may_come=sub == "notify",
        )
        self._left = None
        if isinstance(opened, Pin):
            return self._move(opened)
        if sub == "notify":
            return Notification(opened.payload, opened.timestamp_s)
        return _parse_reply(opened.payload)

    def _move(self, pin: Pin) -> Moved:
        # Everybody who has the pin can forge this (docs/explanation/threats-qrkey.md): no key of this mode is known
        # to the server alone.
        if pin == self.epoch.pin:
            raise BadPayload("pin message with the current pin")
        self._left = self.epoch
        return self._go(derive_epoch(pin))

    def _go(self, epoch: Epoch) -> Moved:
        left = self.subscriptions()
        self.epoch = epoch
        joined = self.subscriptions()
        return Moved(self.epoch, (*map(Subscribe, joined), *(Unsubscribe(t) for t in left if t not in joined)))

    def _publish(self, sub: SubTopic, payload: Any, now_s: float) -> Publish:
        limit = self.config.max_to_server_bytes
        plaintext = encode_to_send(payload, now_s, limit, "servers")
        token = seal(plaintext, self.epoch, self._random_bytes(IV_BYTES))
        return Publish(full_topic(self.config.root, self.epoch.topic, sub), token)


def _parse_reply(payload: Any) -> Reply:
    if not isinstance(payload, dict):
        raise BadPayload("a reply must be an object")
    number = payload.get("request")
    if isinstance(number, bool) or not isinstance(number, int) or "data" not in payload:
        raise BadPayload("a reply must have a request number and data")
    return Reply(number, payload["data"])
