"""A robot's trusted nodes, wherever they are: found, given their keys, and their clock followed."""

from __future__ import annotations

import ipaddress
import logging
import time
from pathlib import Path
from typing import Any

from phalanx.bti.elsewhere import FORWARDED, Elsewhere
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
# To nobody: chained by no a-node and never let out, but the answer has the time.
WHAT_TIME = AUDIT_FRAGMENT.encode(src=0, dst=0, request=0, index=0, count=1, bytes=b"")


class OwnClock:
    """The nodes' own clock, as it shows in what they answer: between a call and its answer it was so late.

    Ours, which runs at `speed` of true time, is moved as little as that allows, so it follows one that drifts. `taken`
    counts packets that the a-node let in, `asked_ms` the time that answers took.
    """

    def __init__(self, node: Elsewhere, speed: float = 1.0) -> None:
        self._node, self.speed = node, speed
        self.taken = 0
        self.asked_ms = 0.0
        self._ahead_ms: float | None = None  # of ours

    def ask(self, call: Record, now_ms: int | None = None, **arguments: Any) -> tuple[int, bytes]:
        """See bti.elsewhere.Elsewhere."""
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
        """The time of the nodes, ms since their power-up; they have a mission key."""
        if self._ahead_ms is None:
            self.ask(lines.SEND, packet=WHAT_TIME)
        assert self._ahead_ms is not None, "without a mission key they tell nothing"
        return int(self._ours_ms() + self._ahead_ms)

    def _ours_ms(self) -> float:
        return self.speed * time.monotonic_ns() / 1e6


def program() -> Path:
    """Trusted nodes as a program, for robots without a board. Raises: UsageError: it was never compiled."""
    if not PROGRAM.exists():
        raise UsageError(f"no program for trusted nodes: {PROGRAM} is not there", "make setup, or pip install again")
    return PROGRAM


def connect_nodes(settings: RobotSettings) -> SerialNode:
    """Return the nodes that the file names, after a handshake.

    Raises: UsageError: no program, a flash that is not ours alone, or a bench; Unavailable: nobody of ours answers.
    """
    kind, _, where = settings.said.trusted.partition(":")
    if kind == "process":
        said = settings.said
        wheels = str(settings.path(said.wheels)) if said.wheels else "-"
        ppm = round(1e6 * (said.clock_speed * (1 + said.clock_ppm / 1e6) - 1))
        clock = f"{ppm},{said.clock_ahead_ms}"
        line = open_line(f"process:{program()},{settings.path(where)}", wheels, clock)
    elif settings.said.wheels:
        raise UsageError(f"wheels beside trusted: {kind}", "a board has its motors itself")
    else:
        if _is_far(settings.said.trusted):
            log.warning(
                "nothing tells who answers at %s: a cable of its own, or nothing is protected", kind + ":" + where
            )
        line = open_line(f"unix:{settings.path(where)}" if kind == "unix" else settings.said.trusted)
    node = SerialNode(line)
    if node.about.told_clock:
        node.close()
        raise UsageError(f"{line.where} is a bench, which is told the time", "a board with a clock of its own")
    # Not before it was opened: in a folder that is shared somebody might lay one there just then.
    if kind == "process" and not _is_private(settings.path(where)):
        node.close()
        raise UsageError(f"{settings.path(where)} is another user's, or open to others", "another file, or chmod 600")
    return node


def _is_private(path: Path) -> bool:
    try:
        return is_ours_alone(path.lstat())
    except OSError:
        return False


def _is_far(trusted: str) -> bool:
    """Return whether they are asked over a network."""
    kind, _, where = trusted.partition(":")
    host = where.rpartition(":")[0].strip("[]")
    try:
        is_here = ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name
        is_here = host == "localhost"
    return kind == "tcp" and not is_here


def check_may_have_key(settings: RobotSettings) -> None:
    """Nothing, if a master key may go where the nodes are. Raises: UsageError: over a network, to whoever answers."""
    if _is_far(settings.said.trusted):
        raise UsageError(
            f"a master key for whoever answers at {settings.said.trusted}",
            "give it over a serial line, or over tcp: to this machine, where an ssh -L may listen",
        )


def provision_keys(node: SerialNode, settings: RobotSettings, limits: Limits) -> MissionKey:
    """Return the mission's key; give new nodes their master key. Raises: UsageError, Refused, Unavailable."""
    said = settings.said
    sealed = read_mission_key(settings.path(said.key), said.robot)
    if node.about.robot_id == 0:
        check_may_have_key(settings)
        if not said.board:
            raise UsageError("its trusted nodes have no master key", "board: FILE, of phalanx keys provision")
        master = read_board(settings.path(said.board), said.robot)
        node.make(limits, sealed=said.radio.sealed)
        node.load_master(master, said.robot)
    elif node.about.robot_id != said.robot:
        raise UsageError(f"its trusted nodes are robot {node.about.robot_id}'s", "another board, or another file")
    elif node.about.sealed != said.radio.sealed:
        were = "were" if node.about.sealed else "were not"
        raise UsageError(
            f"its trusted nodes {were} made for a sealed radio", "change packets: under radio:, or use a new board"
        )
    if sealed.seq <= node.about.seq:
        raise Unavailable(
            f"its trusted nodes have had the key of mission {sealed.seq} already: the robot stands still",
            "phalanx keys issue makes the next mission's key",
        )
    return sealed


def start(node: SerialNode, sealed: MissionKey) -> None:
    """The mission has begun. Raises: UsageError: the key is not sealed for these nodes; Unavailable."""
    try:
        node.load_mission(0, sealed)
    except Refused as error:
        raise UsageError(f"its trusted nodes refuse the mission's key: {error.reason}", "phalanx keys issue") from error
