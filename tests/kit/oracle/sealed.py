"""The sealed radio in plain Python: what firmware/src/seal.c is held to (docs/spec/sealed-radio.md)."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha1

from .nodes import END_OF_CLOCK, PACKET_MAX, ANode, No, u16, u32

SEAL_BYTES, SOURCES, WINDOW_MS, LATE_MS, AHEAD_MS, DRIFT = 14, 64, 64, 2000, 256, 2048


@dataclass
class Source:
    """What is known of a sender: the times it was heard at, and its quickest packet, (t, our clock)."""

    src: int
    times: set[int]
    quickest: tuple[int, int]

    def late(self, now: int, t: int) -> int:
        t0, now0 = self.quickest
        return (now - t) - (now0 - t0) - (now - now0) // DRIFT


class SealedANode(ANode):
    """An a-node whose radio is sealed, for who asks it so."""

    def power_up(self) -> None:
        super().power_up()
        self.sealed_t = 0
        self.sources: list[Source] = []

    def sealed_make(self) -> int:
        if self.master is not None:
            raise No("SEQ")
        return 1

    def seal(self, t: int, src: int, packet: bytes) -> bytes:
        return u32(t) + u16(src) + self.mac(b"\x15" + u32(t) + u16(src) + sha1(packet).digest())

    def sealed_send(self, now: int, packet: bytes) -> bytes:
        self.may_forward(now, packet)
        if len(packet) + SEAL_BYTES > PACKET_MAX:
            raise No("TOO_LONG")
        t = max(now, self.sealed_t + 1)
        if t > min(now + AHEAD_MS, END_OF_CLOCK):
            raise No("AIRTIME")
        entry = self.send(now, packet)
        self.sealed_t = t
        return entry + self.seal(t, self.robot_id, entry[7:])

    def sealed_recv(self, now: int, sealed: bytes) -> bytes:
        self.may_forward(now, sealed)
        if len(sealed) <= SEAL_BYTES:
            raise No("ARG")
        packet, end = sealed[:-SEAL_BYTES], sealed[-SEAL_BYTES:]
        t, src = int.from_bytes(end[:4], "little"), int.from_bytes(end[4:6], "little")
        if self.seal(t, src, packet) != end:
            raise No("BAD_MAC")
        if src == 0:
            raise No("ARG")
        if src == self.robot_id:
            raise No("SELF")
        self.admit(now, t, src)
        return self.recv(now, packet)

    def admit(self, now: int, t: int, src: int) -> None:
        of = next((each for each in self.sources if each.src == src), None)
        if of is None:
            self.begin(now, Source(src, {t}, (t, now)))
            return
        if t in of.times or t <= max(of.times) - WINDOW_MS:
            raise No("REPEATED")
        late = of.late(now, t)
        if late > LATE_MS:
            raise No("LATE")
        of.times.add(t)
        if late < 0:
            of.quickest = t, now

    def begin(self, now: int, new: Source) -> None:
        """In a free place, or that of who was silent longest."""
        if len(self.sources) < SOURCES:
            self.sources.append(new)
            return
        silent = [each.late(now, max(each.times)) for each in self.sources]
        if max(silent) <= self.limits.t_val_ms:
            raise No("FULL")
        self.sources[silent.index(max(silent))] = new
