"""A planner in another process: it receives what the robot senses and hears, and sends advice.

Nothing here blocks: a planner that hangs, floods, sends garbage or is gone costs the robot only some system calls per
reading. The guard brakes when its last advice is too old. Packets are records of the byte table, one per datagram.
"""

from __future__ import annotations

import ipaddress
import logging
import socket
from collections import deque
from pathlib import Path

from phalanx.bti import trusted
from phalanx.errors import UsageError
from phalanx.net.serial_line import check_owner
from phalanx.net.udp_radio import parse_address
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import guarded
from phalanx.wire.fields import row
from phalanx.wire.table import KIND_STATE, SENSOR, STATE

log = logging.getLogger(__name__)

PLANNERS = ("unix", "udp")
HINT = "use unix:PATH or udp:ADDRESS:PORT of phalanx robot advise"
# Packets read per reading, more than a socket buffers: a flood cannot delay genuine advice.
MOST_AT_ONCE = 512
MOST_LOOKS = 32  # of these, packets whose signatures are checked
PACKET_BYTES = guarded.SIGNED_BYTES + 1


class FarPlanner:
    """Client of a planner at `where`; counts advice `taken`, and `rubbish`. Raises: UsageError: invalid address."""

    def __init__(self, where: str, folder: Path, scenario: Scenario, rob_id: int, mission: int) -> None:
        kind, _, self._at = where.partition(":")
        self._path = folder / self._at if kind == "unix" else None
        self._address = None if self._path else parse_address(self._at)
        self._id, self._mission = rob_id, mission
        self._key = row(bytes.fromhex(scenario.guard.adviser_key)) if scenario.guard.adviser_key else None
        self._advised_ms = -1  # time of the newest signed advice
        # Times of readings that signed advice can answer: advice for other times is rejected before its signature is.
        self._asked_ms: deque[int] = deque(maxlen=scenario.guard.advice_ms // scenario.bti.t_control_ms + 2)
        self._looks = 0
        self.taken = self.rubbish = 0
        self._socket: socket.socket | None = None
        self._was_there = True
        if self._address and self._key is None and not ipaddress.ip_address(self._address[0]).is_loopback:
            log.warning("robot %d: anybody at %s may advise it: the mission's guard has no adviser_key", rob_id, where)

    def advice(self, reading: bytes) -> bytes:
        """Return the newest advice received, or b"", and send the reading to the planner."""
        newest, self._looks = b"", MOST_LOOKS
        for _ in range(MOST_AT_ONCE):
            try:
                packet = self._receive()
            except BlockingIOError:
                break
            except OSError:  # over UDP: the last packet was not delivered
                continue
            if self._is_advice(packet):
                newest = packet
                self.taken += 1
            else:
                self.rubbish += 1
        if self._key is not None and len(reading) == SENSOR.size:
            _, _, t_ms, *_ = SENSOR.form.unpack(reading)
            self._asked_ms.append(t_ms)
        self._send(reading)
        return newest

    def forward_state(self, packet: bytes) -> None:
        """Send a received broadcast to the planner, if it is a robot's state."""
        if len(packet) == STATE.size and packet[0] == KIND_STATE:
            self._send(packet)

    def close(self) -> None:
        """Close the socket."""
        if self._socket:
            self._socket.close()
        self._socket = None

    def _is_advice(self, packet: bytes) -> bool:
        """Return whether a packet is advice for this robot; other packets are not even logged."""
        if self._key is None:
            return len(packet) == guarded.WISH.size and packet[0] == guarded.KIND_WISH
        if len(packet) != guarded.SIGNED_BYTES or packet[0] != guarded.KIND_SIGNED_WISH:
            return False
        _, mission, rob_id, t_ms, *_ = guarded.SIGNED_WISH.form.unpack(packet[: guarded.SIGNED_WISH.size])
        if (mission, rob_id) != (self._mission, self._id) or t_ms <= self._advised_ms or t_ms not in self._asked_ms:
            return False
        self._looks -= 1
        if self._looks < 0 or trusted.order_check(self._key, row(packet), len(packet)) != 0:
            return False
        self._advised_ms = t_ms
        return True

    def _receive(self) -> bytes:
        """Return the next packet; over UDP it may be empty. Raises: BlockingIOError: none; OSError: over UDP."""
        if not self._socket:
            raise BlockingIOError
        try:
            packet = self._socket.recv(PACKET_BYTES)
        except BlockingIOError:
            raise
        except OSError:
            if not self._path:
                raise
            packet = b""
        if not packet and self._path:
            self.close()
            raise BlockingIOError
        return packet

    def _send(self, packet: bytes) -> None:
        if not self._socket and not self._connect():
            return
        assert self._socket
        try:
            self._socket.send(packet)
        except BlockingIOError:  # its queue is full: it gets the next packet
            return
        except OSError:
            if self._path:
                self.close()

    def _connect(self) -> bool:
        if self._address:
            made = socket.socket(socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET, socket.SOCK_DGRAM)
        else:
            made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        made.setblocking(False)
        try:
            made.connect(self._address or str(self._path))
            if self._path:
                check_owner(made)
        except OSError as error:
            made.close()
            if self._was_there:
                log.warning("robot %d: no planner at %s: %s", self._id, self._at, error.strerror)
            self._was_there = False
            return False
        self._socket, self._was_there = made, True
        return True


def check_adviser(scenario: Scenario, *, is_far: bool) -> None:
    """Check that a planner can sign, if the mission requires that. Raises: UsageError: it cannot."""
    if scenario.guard.adviser_key and not is_far:
        raise UsageError("the mission has an adviser_key, the planner is no separate process", f"planner: {HINT}")


def is_far(words: str) -> bool:
    """Return whether this planner is a separate process."""
    return words.partition(":")[0] in PLANNERS
