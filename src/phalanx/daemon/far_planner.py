"""A planner in another process: it is sent what the robot senses and hears, and its advice is taken when it has come.

Nothing here waits: one that hangs, floods, says rubbish or is gone costs the robot some system calls a reading, and the
guard brakes when its last advice is old. Packets are records of the byte table, one a datagram.
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
from phalanx.net.udp_radio import parsed
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import guarded
from phalanx.wire.fields import row
from phalanx.wire.table import KIND_STATE, SENSOR, STATE

log = logging.getLogger(__name__)

PLANNERS = ("unix", "udp")
HINT = "unix:PATH or udp:ADDRESS:PORT of phalanx robot advise"
# Packets that are taken at a reading, more than a socket keeps: a flood does not push true advice back.
MOST_AT_ONCE = 512
MOST_LOOKS = 32  # at signatures, in these
PACKET_BYTES = guarded.SIGNED_BYTES + 1


class FarPlanner:
    """Asks at `where` for a robot's advice; counts `taken` advice, and `rubbish`. Raises: UsageError: no address."""

    def __init__(self, where: str, folder: Path, scenario: Scenario, rob_id: int, mission: int) -> None:
        kind, _, self._at = where.partition(":")
        self._path = folder / self._at if kind == "unix" else None
        self._address = None if self._path else parsed(self._at)
        self._id, self._mission = rob_id, mission
        self._key = row(bytes.fromhex(scenario.guard.adviser_key)) if scenario.guard.adviser_key else None
        self._advised_ms = -1  # the date of the newest that was signed
        # Of readings that signed advice may answer: who has not seen them costs us no look at a signature.
        self._asked_ms: deque[int] = deque(maxlen=scenario.guard.advice_ms // scenario.bti.t_control_ms + 2)
        self._looks = 0
        self.taken = self.rubbish = 0
        self._socket: socket.socket | None = None
        self._was_there = True
        if self._address and self._key is None and not ipaddress.ip_address(self._address[0]).is_loopback:
            log.warning("robot %d: anybody at %s may advise it: the mission's guard has no adviser_key", rob_id, where)

    def advice(self, reading: bytes) -> bytes:
        """The newest advice that has come, b"" for none; and the planner is sent the reading."""
        newest, self._looks = b"", MOST_LOOKS
        for _ in range(MOST_AT_ONCE):
            try:
                packet = self._receive()
            except BlockingIOError:
                break
            except OSError:  # over UDP: nobody listened there when we spoke
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
        """The planner is sent a broadcast, if it is one of where a robot is."""
        if len(packet) == STATE.size and packet[0] == KIND_STATE:
            self._send(packet)

    def close(self) -> None:
        """Nobody is asked any more."""
        if self._socket:
            self._socket.close()
        self._socket = None

    def _is_advice(self, packet: bytes) -> bool:
        """Return whether it is advice for this robot: what is not, is not even logged."""
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
        """The next packet; over UDP one may be empty. Raises: BlockingIOError: none has come; OSError: over UDP."""
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
        except BlockingIOError:  # it takes nothing: it will be sent the next
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
                log.warning("robot %d: nobody advises it at %s: %s", self._id, self._at, error.strerror)
            self._was_there = False
            return False
        self._socket, self._was_there = made, True
        return True


def check_adviser(scenario: Scenario, *, is_far: bool) -> None:
    """Nothing, if its robots' planner can sign. Raises: UsageError: it names an adviser, and the planner is not far."""
    if scenario.guard.adviser_key and not is_far:
        raise UsageError("a mission that names an adviser, and a planner of the robot's own", f"planner: {HINT}")


def is_far(words: str) -> bool:
    """Return whether the planner of that name is another process."""
    return words.partition(":")[0] in PLANNERS
