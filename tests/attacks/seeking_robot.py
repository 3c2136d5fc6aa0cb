"""Robots that lack tokens and send SEEK, and others' SEEK as they receive it."""

from __future__ import annotations

from asking import BOOT_MS, ROUND_MS, VICTIM, Asking

from phalanx.bti import audit, rounds, seeking
from phalanx.robot import actions, handlers
from phalanx.robot.actions import Action, RetryAt, Transmit
from phalanx.wire.fields import row
from phalanx.wire.table import AUDIT_HERE, AUDIT_SEEK

ASKER = 5


class Unheard(Asking):
    """Its fragments are lost."""

    def sends(self, now_ms: int) -> bytes:
        """Return the fragment that goes out now, if one does."""
        n = handlers.next_fragment(self.fleet, VICTIM, self.work, now_ms)
        return self.work.packet[:n].tobytes()

    def loses(self, now_ms: int) -> None:
        """Lose the last fragment."""
        seeking.give_up_request(self.fleet, VICTIM, now_ms, self.work.small[1])

    def seeks(self, now_ms: int) -> None:
        """Send SEEK, and receive answers of all others."""
        self.loses(now_ms)
        seeking.write_seek(self.fleet, VICTIM, now_ms, self.work.packet)
        for rob_id in range(2, 9):
            self.receives_here(rob_id, int(self.robot.nonce), now_ms)
        self.robot.quota = 1

    def receives_here(self, rob_id: int, nonce: int, now_ms: int) -> None:
        here = row(AUDIT_HERE.encode(src=rob_id, dst=VICTIM + 1, nonce=nonce))
        assert handlers.on_packet(self.fleet, VICTIM, self.work, now_ms, here, len(here)) == handlers.NOTHING

    def pauses_ms(self, now_ms: int) -> list[int]:
        """Return how long it waits each time, until it gives up."""
        waited, fragment = [], self.sends(now_ms)
        assert fragment
        while True:
            self.loses(now_ms)
            if self.robot.request_len == 0:
                return waited
            pause_ms = int(rounds.next_retry(self.fleet, VICTIM, now_ms)) - now_ms
            assert self.sends(now_ms + pause_ms - 1) == b""
            assert self.sends(now_ms + pause_ms) == fragment, "the same fragment, alone"
            waited.append(pause_ms)
            now_ms += pause_ms


class Seeking(Asking):
    """A robot whose first round has given it nothing."""

    def __init__(self):
        super().__init__()
        rounds.begin_round(self.fleet, VICTIM, BOOT_MS)
        self.now_ms = BOOT_MS + ROUND_MS

    def senses(self, now_ms: int) -> None:
        """Take a reading, so that its s-chain is another."""
        handlers.take(self.fleet, VICTIM, self.work, audit.INPUT, now_ms, row(bytes(8)), 8)

    def event(self, handler, *args: int) -> list[Action]:
        handler(self.fleet, VICTIM, self.work, *args)
        return actions.decode(self.work)

    def round_due(self, *, listened: bool) -> list[Action]:
        return self.event(handlers.on_round, self.now_ms, int(listened), 0)

    def receives(self, packet: bytes, now_ms: int) -> list[Action]:
        handlers.on_packet(self.fleet, VICTIM, self.work, now_ms, row(packet), len(packet))
        return actions.decode(self.work)


def seek_of(src: int, nonce: int = 77, since: int = 0) -> bytes:
    return AUDIT_SEEK.encode(src=src, dst=0, nonce=nonce, since=since, share=255)


def sent(asked: list[Action]) -> list[bytes]:
    return [each.packet for each in asked if isinstance(each, Transmit)]


def retry_ms(asked: list[Action]) -> int:
    return min(each.at_ms for each in asked if isinstance(each, RetryAt))
