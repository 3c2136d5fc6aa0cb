"""Connect to a robot's trusted nodes, load their keys, and follow their clock."""

from __future__ import annotations

import ipaddress
import logging
import time
from pathlib import Path
from typing import Any

from phalanx.bti.elsewhere import FORWARDED, RemoteNodes
from phalanx.bti.nodes import Limits, MissionKey, Refused
from phalanx.errors import Unavailable, UsageError
from phalanx.net.mission_key import read_board, read_mission_key
from phalanx.net.private_file import is_ours_alone
from phalanx.net.serial_line import open_line
from phalanx.net.serial_node import SerialNode
from phalanx.wire import Record, lines
from phalanx.wire.fields import get_u32, row
from phalanx.wire.table import AUDIT_FRAGMENT, ENTRY

from .settings import RobotSettings

log = logging.getLogger(__name__)

# Compiled when the package is installed (release/build_commands.py).
PROGRAM = Path(__file__).parents[1] / "trusted_node"
AT_T = ENTRY.at("t")
# A packet without receiver: no a-node logs or sends it, but the answer has the time.
WHAT_TIME = AUDIT_FRAGMENT.encode(src=0, dst=0, request=0, index=0, count=1, bytes=b"")


class NodeClock:
    """Estimate of the nodes' clock from their answers, which were made between a call and its return.

    Our clock, which runs at `speed` of real time, is adjusted as little as the answers allow, so it follows drift.
    `taken` counts packets that the a-node accepted, `asked_ms` is the total time of calls.
    """

    def __init__(self, node: RemoteNodes, speed: float = 1.0) -> None:
        self._node, self.speed = node, speed
        self.taken = 0
        self.asked_ms = 0.0
        self._ahead_ms: float | None = None  # of ours

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See `bti.elsewhere.RemoteNodes`."""
        before_ms = self._ours_ms()
        code, result = self._node.ask(call, now_ms, **arguments)
        after_ms = self._ours_ms()
        self.asked_ms += (after_ms - before_ms) / self.speed
        self.taken += call is lines.RECV and code >= 0
        if call in FORWARDED and code > 0:
            t = get_u32(row(result), AT_T)
            least, most = t - after_ms, t + 1 - before_ms
            ahead_ms = (least + most) / 2 if self._ahead_ms is None else self._ahead_ms
            self._ahead_ms = min(max(ahead_ms, least), most)
        return code, result

    def now_ms(self) -> int:
        """Return the nodes' time, ms since their power-up; requires a mission key."""
        if self._ahead_ms is None:
            self.ask(lines.SEND, packet=WHAT_TIME)
        assert self._ahead_ms is not None, "the nodes have no mission key"
        return int(self._ours_ms() + self._ahead_ms)

    def _ours_ms(self) -> float:
        return self.speed * time.monotonic_ns() / 1e6


def program() -> Path:
    """Return the path of the trusted nodes' program, for robots without a board. Raises: UsageError: not compiled."""
    if not PROGRAM.exists():
        raise UsageError(f"no program for trusted nodes: {PROGRAM} is missing", "run make setup, or pip install again")
    return PROGRAM


def connect_nodes(settings: RobotSettings) -> SerialNode:
    """Return the nodes that the file names, after a handshake.

    Raises: UsageError: no program, a flash file open to others, or a test board; Unavailable: no answer.
    """
    kind, _, where = settings.said.trusted.partition(":")
    if kind == "process":
        said = settings.said
        wheels = str(settings.path(said.wheels)) if said.wheels else "-"
        ppm = round(1e6 * (said.clock_speed * (1 + said.clock_ppm / 1e6) - 1))
        clock = f"{ppm},{said.clock_ahead_ms}"
        line = open_line(f"process:{program()},{settings.path(where)}", wheels, clock)
    elif settings.said.wheels:
        raise UsageError(f"wheels with trusted: {kind}", "leave wheels out: a board controls its motors itself")
    else:
        if _is_far(settings.said.trusted):
            log.warning("trusted nodes at %s are not authenticated: use a dedicated cable", kind + ":" + where)
        line = open_line(f"unix:{settings.path(where)}" if kind == "unix" else settings.said.trusted)
    node = SerialNode(line)
    if node.about.told_clock:
        node.close()
        raise UsageError(f"{line.where} is a test board without a clock", "use a board with its own clock")
    # Checked after opening: in a shared folder another user could create the file just before.
    if kind == "process" and not _is_private(settings.path(where)):
        node.close()
        raise UsageError(f"{settings.path(where)} is another user's, or open to others", "use chmod 600, or another")
    return node


def _is_private(path: Path) -> bool:
    try:
        return is_ours_alone(path.lstat())
    except OSError:
        return False


def _is_far(trusted: str) -> bool:
    """Return whether the nodes are reached over a network."""
    kind, _, where = trusted.partition(":")
    host = where.rpartition(":")[0].strip("[]")
    try:
        is_here = ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name
        is_here = host == "localhost"
    return kind == "tcp" and not is_here


def check_may_have_key(settings: RobotSettings) -> None:
    """Check that a master key may be sent to the nodes. Raises: UsageError: over an unauthenticated network."""
    if _is_far(settings.said.trusted):
        raise UsageError(
            f"cannot send a master key to {settings.said.trusted}: no authentication",
            "use a serial line, or tcp: to this machine, such as to a tunnel of ssh -L",
        )


def provision_keys(node: SerialNode, settings: RobotSettings, limits: Limits) -> MissionKey:
    """Return the mission's key; load the master key into new nodes. Raises: UsageError, Refused, Unavailable."""
    said = settings.said
    sealed = read_mission_key(settings.path(said.key), said.robot)
    if node.about.robot_id == 0:
        check_may_have_key(settings)
        if not said.board:
            raise UsageError("its trusted nodes have no master key", "add board: FILE, from phalanx keys provision")
        master = read_board(settings.path(said.board), said.robot)
        node.make(limits, sealed=said.radio.sealed)
        node.load_master(master, said.robot)
    elif node.about.robot_id != said.robot:
        raise UsageError(f"its trusted nodes belong to robot {node.about.robot_id}", "use another board, or file")
    elif node.about.sealed != said.radio.sealed:
        were = "were" if node.about.sealed else "were not"
        raise UsageError(
            f"its trusted nodes {were} made for a sealed radio", "change packets: under radio:, or use a new board"
        )
    if sealed.seq <= node.about.seq:
        raise Unavailable(
            f"its trusted nodes already had the key of mission {sealed.seq}: the robot stands still",
            "issue the next mission's key: phalanx keys issue",
        )
    return sealed


def start(node: SerialNode, sealed: MissionKey) -> None:
    """Load the mission key, which starts the mission. Raises: UsageError: sealed for other nodes; Unavailable."""
    try:
        node.load_mission(0, sealed)
    except Refused as error:
        hint = "issue the key for these nodes: phalanx keys issue"
        raise UsageError(f"its trusted nodes refuse the mission's key: {error.reason}", hint) from error
