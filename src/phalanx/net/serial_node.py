"""A robot's two trusted nodes at the other end of a serial line, asked as those in this process are.

A call whose answer does not come is said again with its number, which the board answers without doing it again: rubbish
on the line costs time and nothing else. What has no answer within the limit ends the line, since nobody knows whether
it was done. Source: docs/spec/serial.md.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

from phalanx.bti import trusted
from phalanx.bti.elsewhere import FORWARDED, made_by
from phalanx.bti.nodes import Limits, MissionKey, Refused
from phalanx.errors import PeerError, Unavailable
from phalanx.wire import Record, lines
from phalanx.wire.framing import Frames, framed
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX, SEAL

from .serial_line import SerialLine

TIMEOUT_S = 1.0  # from a call to its answer, however often it is said
# Before a mission: a process begins, flash is written, and no robot moves yet that would wait for it.
BEGINS_TIMEOUT_S = 10.0
BEGINS = frozenset((lines.HELLO, lines.LIMITS, lines.SEAL, lines.LOAD_MASTER, lines.LOAD_MISSION))
AGAIN_S = 0.1  # until it is said again, beside what the bytes themselves take on the line
DONE, SAFE = 0, 1  # what is returned by functions that make no entry
NUMBERS = 1 << 16
ANSWER_HEAD_BYTES = lines.ANSWER.size + ENTRY_HEADER_BYTES
ANSWER_MAX = ANSWER_HEAD_BYTES + PACKET_MAX
SEAL_BYTES = {lines.SEND: SEAL.size, lines.RECV: -SEAL.size}  # more in what is made than in what is given


@dataclass(frozen=True, slots=True)
class About:
    """What a board says of itself."""

    told: int
    robot_id: int  # 0: no master key yet
    seq: int  # of the last mission key

    @property
    def told_clock(self) -> bool:
        """It is a bench: whoever asks tells it the time."""
        return bool(self.told & lines.TOLD_CLOCK)

    @property
    def sealed(self) -> bool:
        """A seal goes out behind each frame that is sent, and comes in behind each that is taken."""
        return bool(self.told & lines.SEALED)


class SerialNode:
    """The board at the end of `line`, after a handshake; both nodes of one robot.

    Attributes:
        about: what it said of itself.
        again: calls that were said again, ever.

    Args:
        line: it is ours from now on.
        timeout_s: how long a call may take; those before a mission may take 10 s.
        again_s: after how long without an answer it is said again; twice as long each time.
    Raises: Unavailable: nobody answers, or in another version.
    """

    def __init__(self, line: SerialLine, *, timeout_s: float = TIMEOUT_S, again_s: float = AGAIN_S) -> None:
        self._line, self._timeout_s, self._again_s = line, timeout_s, again_s
        self._frames = Frames(ANSWER_MAX)
        self._number = 0
        self._now_ms = 0
        self._ended = ""
        self.again = 0
        _, said = self._call(lines.HELLO, version=lines.VERSION)
        version = said[lines.ABOUT.at("version")] if said else 0
        if version != lines.VERSION:
            raise self._end(f"{line.where} speaks version {version} of the serial line, and we {lines.VERSION}")
        try:
            about = lines.ABOUT.decode(said)
        except PeerError as error:
            raise self._end(f"{line.where} says of itself what nobody understands") from error
        self.about = About(about["told"], about["id"], about["seq"])
        self._seal_bytes = SEAL_BYTES if self.about.sealed else {}

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See `elsewhere.Elsewhere`."""
        if now_ms is not None and now_ms != self._now_ms and self.about.told_clock:
            code, _ = self._call(lines.CLOCK, t=now_ms)
            if code:
                raise self._end(f"{self._line.where} is told that it is earlier than it was")
            self._now_ms = now_ms
        if call in FORWARDED:
            # A longer one is refused as this is.
            arguments = {name: data[: PACKET_MAX + 1] for name, data in arguments.items()}
        code, result = self._call(call, **arguments)
        wanted = made_by(call, **arguments) + self._seal_bytes.get(call, 0) if code >= 0 else 0
        known = code in trusted.REASONS or code in (DONE, SAFE) or (call in FORWARDED and code == wanted)
        if not known or len(result) != wanted:
            raise self._end(f"{self._line.where} answers {call.name} with {len(result)} bytes and code {code}")
        return code, result

    # --- from outside the c-node -----------------------------------------------------------------------------------

    def make(self, limits: Limits, *, sealed: bool = False) -> None:
        """Manufacture: both nodes have these limits. Raises: Refused: they have a master key; Unavailable."""
        _checked(self.ask(lines.LIMITS, **asdict(limits)))
        self._seal_bytes = SEAL_BYTES if sealed else {}
        if sealed:
            _checked(self.ask(lines.SEAL))

    def load_master(self, key: bytes, robot_id: int) -> None:
        """Both nodes have their master key, for ever. Raises: Refused; Unavailable. Source: RoboRebound Alg. 2."""
        _checked(self.ask(lines.LOAD_MASTER, key=key, id=robot_id))

    def load_mission(self, now_ms: int, sealed: MissionKey) -> None:
        """Both nodes have the mission key. Raises: Refused; Unavailable. Source: RoboRebound Alg. 2."""
        _checked(self.ask(lines.LOAD_MISSION, now_ms, **sealed._asdict()))

    def close(self) -> None:
        """The line is closed."""
        self._ended = self._ended or f"{self._line.where} is closed"
        self._line.close()

    # --- the line ----------------------------------------------------------------------------------------------------

    def _call(self, call: Record, **arguments: Any) -> tuple[int, bytes]:
        if self._ended:
            raise Unavailable(self._ended)
        self._number = (self._number + 1) % NUMBERS
        frame = framed(call.encode(number=self._number, **arguments))
        timeout_s = max(self._timeout_s, BEGINS_TIMEOUT_S) if call in BEGINS else self._timeout_s
        end_s = time.monotonic() + timeout_s
        # What is answered to a frame is as long, or shorter.
        again_s = self._again_s + 2 * (len(frame) + ANSWER_HEAD_BYTES) * self._line.byte_s
        first = True
        try:
            while time.monotonic() < end_s:
                self.again += not first
                first = False
                self._line.send(frame, end_s)
                answered = self._answer(min(end_s, time.monotonic() + again_s))
                if answered:
                    return self._understood(*answered)
                # A board that is slow must not be given more and more to read.
                again_s *= 2
        except Unavailable as error:
            raise self._end(str(error)) from error
        raise self._end(f"{self._line.where} has not answered {call.name} within {timeout_s:g} s")

    def _answer(self, until_s: float) -> tuple[int, bytes] | None:
        while True:
            raw = self._line.receive(until_s)
            for payload in self._frames.feed(raw):
                try:
                    said = lines.ANSWER.decode(payload)
                except PeerError:
                    continue
                # An answer that was late belongs to a call that was answered when it was said again.
                if said["number"] == self._number:
                    return said["code"], said["result"]
            if time.monotonic() >= until_s:
                return None

    def _understood(self, code: int, result: bytes) -> tuple[int, bytes]:
        if code == lines.E_HELLO:
            raise self._end(f"{self._line.where} has lost power since its handshake, and its mission with it")
        if code == lines.E_CALL:
            raise self._end(f"{self._line.where} does not know this call")
        return code, result

    def _end(self, why: str) -> Unavailable:
        self._ended = why
        self._line.close()
        return Unavailable(why)


def _checked(answered: tuple[int, bytes]) -> None:
    if answered[0] < 0:
        raise Refused(answered[0])
