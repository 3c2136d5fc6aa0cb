"""State updates: encrypted once for all visitors, signed by the swarm, with keys that do not open earlier updates.

Each update has its own key, from a hash chain: with the chain key of one update a visitor reads it and later ones.
"""

from __future__ import annotations

import hmac
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from phalanx.config.session import SessionConfig
from phalanx.errors import NotAuthentic, Replayed
from phalanx.wire.sessions import SIGNED_UPDATE, TAG_BYTES, UPDATE, UPDATE_HEAD

from .errors import UnknownEpoch
from .messages import Epoch
from .noise import KEY_BYTES, Cipher
from .padding import check_size, pad, unpad
from .secret import PROTOCOL, TOPIC_BYTES
from .window import COUNTER_LIMIT

DIGEST_BYTES = 8
REMEMBERED = 64  # updates that a command may refer to
SKIP_LIMIT = 20_000  # updates that a client may miss: more than an epoch at 20 Hz
_KEY, _NEXT = PROTOCOL + b"update", PROTOCOL + b"chain"


@dataclass(slots=True)
class Chain:
    """Chain key of the next update of an epoch, from which the keys of all later ones are derived."""

    epoch: int
    counter: int  # counter of the update that the key belongs to
    key: bytes = field(repr=False)
    topic: bytes

    def advance(self, counter: int) -> None:
        """Advance to the key of a later update; keys of earlier ones cannot be derived from it."""
        while self.counter < counter:
            self.key = hmac.digest(self.key, _NEXT, "sha256")
            self.counter += 1

    def cipher(self) -> Cipher:
        """Return the cipher of the update."""
        return Cipher(hmac.digest(self.key, _KEY, "sha256"))

    def message(self) -> Epoch:
        """Return the message that lets a visitor read updates from here on."""
        return Epoch(self.epoch, self.counter, self.key, self.topic)


class UpdateWriter:
    """The swarm's side: encrypts and signs updates.

    Args:
        signer: the swarm's key; visitors get its public half when they are admitted.
        random_bytes: returns n bytes from a cryptographic source.
    """

    def __init__(
        self, config: SessionConfig, signer: Ed25519PrivateKey, random_bytes: Callable[[int], bytes], now_ms: int
    ) -> None:
        self._config, self._signer, self._random_bytes = config, signer, random_bytes
        self.public = signer.public_key().public_bytes_raw()
        self._counter = 0
        self._sent: OrderedDict[int, tuple[bytes, int]] = OrderedDict()
        self._next: Chain | None = None
        self._now = self._make(0)
        self._begun_ms = now_ms

    @property
    def topic(self) -> bytes:
        """Return the topic of updates on a broker in the current epoch."""
        return self._now.topic

    def epochs(self) -> list[Epoch]:
        """Return the keys for a visitor that is admitted now; they do not open earlier updates."""
        return [chain.message() for chain in (self._now, self._next) if chain]

    def begin(self, now_ms: int) -> Epoch:
        """Begin a new epoch at once, after a visitor was removed; return its key, for all others."""
        self._now = self._make((self._next or self._now).epoch + 1)
        self._next, self._begun_ms = None, now_ms
        return self._now.message()

    def tick(self, now_ms: int) -> Epoch | None:
        """Make the next epoch's key some time before its first use; return it for all visitors, or None if not due."""
        age = now_ms - self._begun_ms
        if self._next and age >= self._config.epoch_ms:
            self._now, self._next, self._begun_ms = self._next, None, now_ms
        elif self._next is None and age >= self._config.epoch_ms - self._config.epoch_notice_ms:
            self._next = self._make(self._now.epoch + 1)
            return self._next.message()
        return None

    def seal(self, state: bytes, now_ms: int) -> bytes:
        """Encrypt and sign the next update. Raises: UsageError: it is too long."""
        plaintext = pad(state, self._config.max_to_client_bytes)
        self._counter += 1
        chain = self._now
        head = {"epoch": chain.epoch, "counter": self._counter}
        sealed = chain.cipher().seal(self._counter, plaintext, UPDATE_HEAD.encode(**head))
        signature = self._signer.sign(SIGNED_UPDATE.encode(**head, sealed=sealed))
        update = UPDATE.encode(**head, sealed=sealed, signature=signature)
        for each in (chain, self._next):
            if each:
                each.advance(self._counter + 1)
        self._sent[self._counter] = digest_of(update), now_ms
        if len(self._sent) > REMEMBERED:
            self._sent.popitem(last=False)
        return update

    def is_recent(self, seen: int, digest: bytes, now_ms: int) -> bool:
        """Return whether a command refers to an update that was sent at most `late_ms` ago."""
        own, sent_ms = self._sent.get(seen, (b"", 0))
        return hmac.compare_digest(own, digest) and now_ms - sent_ms <= self._config.late_ms

    def _make(self, epoch: int) -> Chain:
        return Chain(epoch, self._counter + 1, self._random_bytes(KEY_BYTES), self._random_bytes(TOPIC_BYTES))


class UpdateReader:
    """A visitor's side. Attributes: seen, digest: counter and digest of the newest update; zeros before the first."""

    def __init__(self, config: SessionConfig, signer: bytes) -> None:
        """Verify updates with `signer`, the swarm's public key. Raises: NotAuthentic: not a valid key."""
        try:
            self._signer = Ed25519PublicKey.from_public_bytes(signer)
        except ValueError as error:
            raise NotAuthentic("not an Ed25519 public key") from error
        self._config = config
        self._chains: dict[int, Chain] = {}  # at most two
        self.seen, self.digest = 0, bytes(DIGEST_BYTES)

    def learn(self, epoch: Epoch) -> None:
        """Add the key of an epoch, received in a session; only the newest two epochs are kept."""
        known = self._chains.get(epoch.epoch)
        if known is None or known.counter < epoch.counter:
            self._chains[epoch.epoch] = Chain(epoch.epoch, epoch.counter, epoch.chain, epoch.topic)
        for old in sorted(self._chains)[:-2]:
            del self._chains[old]

    def topics(self) -> list[bytes]:
        """Return the topics of updates on a broker."""
        return [chain.topic for chain in self._chains.values()]

    def open(self, raw: bytes) -> bytes:
        """Open an update; a refused one changes nothing.

        Raises: TooLarge, MalformedRecord, Replayed, UnknownEpoch, NotAuthentic.
        """
        check_size(raw, UPDATE.size + self._config.max_to_client_bytes + TAG_BYTES)
        fields = UPDATE.decode(raw)
        epoch, counter, sealed = fields["epoch"], fields["counter"], fields["sealed"]
        chain = self._chains.get(epoch)
        if chain is None:
            raise UnknownEpoch(f"no key for epoch {epoch}")
        if counter <= self.seen or counter < chain.counter:
            raise Replayed(f"update {counter}, newest {self.seen}")
        if counter - chain.counter > SKIP_LIMIT or counter >= COUNTER_LIMIT:
            raise UnknownEpoch(f"update {counter} is too far ahead")
        # Verify before advancing the chain, which costs a hash for each missed update.
        try:
            self._signer.verify(fields["signature"], SIGNED_UPDATE.encode(epoch=epoch, counter=counter, sealed=sealed))
        except InvalidSignature as error:
            raise NotAuthentic("the signature does not verify") from error
        ahead = Chain(chain.epoch, chain.counter, chain.key, chain.topic)
        ahead.advance(counter)
        state = unpad(ahead.cipher().open(counter, sealed, UPDATE_HEAD.encode(epoch=epoch, counter=counter)))
        ahead.advance(counter + 1)
        self._chains = {number: each for number, each in self._chains.items() if number > epoch} | {epoch: ahead}
        self.seen, self.digest = counter, digest_of(raw)
        return state


def digest_of(update: bytes) -> bytes:
    """Return the digest with which commands refer to an update."""
    return sha256(update).digest()[:DIGEST_BYTES]


def is_update(raw: bytes) -> bool:
    """Return whether a message has the tag of an update."""
    return raw[:1] == UPDATE_HEAD.encode(epoch=0, counter=0)[:1]
