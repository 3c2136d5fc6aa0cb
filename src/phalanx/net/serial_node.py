"""Trusted nodes of a robot behind a serial line, with the same interface as nodes in this process.

A call without an answer is repeated with the same number, and the board repeats its answer without executing it again.
So noise on the line costs only time. A call without an answer within the limit closes the line, because it is not
known whether it was executed. Source: docs/spec/serial.md.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

from phalanx.bti import trusted
from phalanx.bti.elsewhere import FORWARDED, output_size
from phalanx.bti.nodes import Limits, MissionKey, Refused
from phalanx.errors import PeerError, Unavailable
from phalanx.wire import Record, lines
from phalanx.wire.framing import Frames, encode_frame
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX, SEAL

from .serial_line import SerialLine

TIMEOUT_S = 1.0  # from a call to its answer, with all repetitions
# For calls before a mission, while a process starts or flash is written, and no robot moves.
BEGINS_TIMEOUT_S = 10.0
BEGINS = frozenset((lines.HELLO, lines.LIMITS, lines.SEAL, lines.LOAD_MASTER, lines.LOAD_MISSION))
AGAIN_S = 0.1  # until a repetition, beside the time of the bytes on the line
DONE, SAFE = 0, 1  # return values of functions without an entry
NUMBERS = 1 << 16
ANSWER_HEAD_BYTES = lines.ANSWER.size + ENTRY_HEADER_BYTES
ANSWER_MAX = ANSWER_HEAD_BYTES + PACKET_MAX
SEAL_BYTES = {lines.SEND: SEAL.size, lines.RECV: -SEAL.size}  # bytes added to or removed from a packet


@dataclass(frozen=True, slots=True)
class About:
    """Description that a board gives of itself."""

    told: int  # bits TOLD_CLOCK, TOLD_READINGS and SEALED of `lines`
    robot_id: int  # 0: no master key yet
    seq: int  # sequence number of the last mission key

    @property
    def told_clock(self) -> bool:
        """Return whether it is a test board, which gets the time from the caller."""
        return bool(self.told & lines.TOLD_CLOCK)

    @property
    def sealed(self) -> bool:
        """Return whether the radio is sealed: a seal follows each packet sent and received."""
        return bool(self.told & lines.SEALED)


class SerialNode:
    """Board with both trusted nodes of one robot, at the end of `line`, after a handshake.

    Attributes:
        about: description of the board.
        again: total number of repetitions.

    Args:
        line: owned by this object from now on.
        timeout_s: timeout of a call; calls before a mission may take 10 s.
        again_s: time without an answer until a repetition; doubled each time.
    Raises: Unavailable: no answer, or another protocol version.
    """

    def __init__(self, line: SerialLine, *, timeout_s: float = TIMEOUT_S, again_s: float = AGAIN_S) -> None:
        self._line, self._timeout_s, self._again_s = line, timeout_s, again_s
        self._frames = Frames(ANSWER_MAX)
        self._number = 0
        self._now_ms = 0
        self._ended = ""
        self.again = 0
        _, raw = self._call(lines.HELLO, version=lines.VERSION)
        version = raw[lines.ABOUT.at("version")] if raw else 0
        if version != lines.VERSION:
            raise self._end(f"{line.where} has version {version} of the serial protocol, not {lines.VERSION}")
        try:
            about = lines.ABOUT.decode(raw)
        except PeerError as error:
            raise self._end(f"{line.where} sent a malformed handshake answer") from error
        self.about = About(about["told"], about["id"], about["seq"])
        self._seal_bytes = SEAL_BYTES if self.about.sealed else {}

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See `elsewhere.RemoteNodes`."""
        if now_ms is not None and now_ms != self._now_ms and self.about.told_clock:
            code, _ = self._call(lines.CLOCK, t=now_ms)
            if code:
                raise self._end(f"{self._line.where} refuses the time {now_ms} ms, which is before its last")
            self._now_ms = now_ms
        if call in FORWARDED:
            # Truncated: the board refuses this length just as a greater one.
            arguments = {name: data[: PACKET_MAX + 1] for name, data in arguments.items()}
        code, result = self._call(call, **arguments)
        wanted = output_size(call, **arguments) + self._seal_bytes.get(call, 0) if code >= 0 else 0
        known = code in trusted.REASONS or code in (DONE, SAFE) or (call in FORWARDED and code == wanted)
        if not known or len(result) != wanted:
            raise self._end(f"{self._line.where} answered {call.name} with {len(result)} bytes and code {code}")
        return code, result

    # --- manufacture and keys --------------------------------------------------------------------------------------

    def make(self, limits: Limits, *, sealed: bool = False) -> None:
        """Set the limits of both nodes, at manufacture. Raises: Refused: they have a master key; Unavailable."""
        _checked(self.ask(lines.LIMITS, **asdict(limits)))
        self._seal_bytes = SEAL_BYTES if sealed else {}
        if sealed:
            _checked(self.ask(lines.SEAL))

    def load_master(self, key: bytes, robot_id: int) -> None:
        """Load the master key into both nodes, for good. Raises: Refused; Unavailable. Source: RoboRebound Alg. 2."""
        _checked(self.ask(lines.LOAD_MASTER, key=key, id=robot_id))

    def load_mission(self, now_ms: int, sealed: MissionKey) -> None:
        """Load the mission key into both nodes. Raises: Refused; Unavailable. Source: RoboRebound Alg. 2."""
        _checked(self.ask(lines.LOAD_MISSION, now_ms, **sealed._asdict()))

    def close(self) -> None:
        """Close the line."""
        self._ended = self._ended or f"{self._line.where} is closed"
        self._line.close()

    # --- the line ----------------------------------------------------------------------------------------------------

    def _call(self, call: Record, **arguments: Any) -> tuple[int, bytes]:
        if self._ended:
            raise Unavailable(self._ended)
        self._number = (self._number + 1) % NUMBERS
        frame = encode_frame(call.encode(number=self._number, **arguments))
        timeout_s = max(self._timeout_s, BEGINS_TIMEOUT_S) if call in BEGINS else self._timeout_s
        end_s = time.monotonic() + timeout_s
        # The answer to a frame has at most the same length plus a header.
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
                # Repetitions must not pile up at a slow board.
                again_s *= 2
        except Unavailable as error:
            raise self._end(str(error)) from error
        raise self._end(f"{self._line.where} did not answer {call.name} within {timeout_s:g} s")

    def _answer(self, until_s: float) -> tuple[int, bytes] | None:
        while True:
            raw = self._line.receive(until_s)
            for payload in self._frames.feed(raw):
                try:
                    answer = lines.ANSWER.decode(payload)
                except PeerError:
                    continue
                # A late answer belongs to an earlier call, of which a repetition was answered.
                if answer["number"] == self._number:
                    return answer["code"], answer["result"]
            if time.monotonic() >= until_s:
                return None

    def _understood(self, code: int, result: bytes) -> tuple[int, bytes]:
        if code == lines.E_HELLO:
            raise self._end(f"{self._line.where} lost power after the handshake, and with it the mission")
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
