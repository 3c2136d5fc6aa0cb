"""Boards to try the serial line with: the firmware's own program as a process, made by firmware/Makefile."""

from __future__ import annotations

import contextlib
import fcntl
import json
import subprocess
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from phalanx.bti import elsewhere, trusted
from phalanx.bti.elsewhere import FORWARDED
from phalanx.bti.nodes import Limits, MissionKey
from phalanx.bti.trusted import REASONS
from phalanx.net.serial_line import open_line
from phalanx.net.serial_node import SerialNode
from phalanx.wire import lines

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "firmware"
# A busy machine may take its time; only who is asked about the limit itself waits for it.
PATIENT = {"timeout_s": 60.0, "again_s": 5.0}


@cache
def built(target: str) -> Path:
    """A program or an image of the firmware."""
    (FIRMWARE / "build").mkdir(exist_ok=True)
    with (FIRMWARE / "build" / "making").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of several processes of tests one makes it
        subprocess.run(["make", "--silent", "-C", str(FIRMWARE), f"build/{target}"], check=True)
    return FIRMWARE / "build" / target


def process(flash: Path, *words: str, **said) -> SerialNode:
    """A board that is a process, with this file as its flash; `told` is a word."""
    return SerialNode(open_line(f"process:{built('node')},{flash}", *words), **(PATIENT | said))


@contextlib.contextmanager
def benches(folder: Path, n: int):
    """So many processes that are told the time."""
    with contextlib.ExitStack() as stack:
        made = []
        for i in range(n):
            made.append(process(folder / f"flash-{i}", "told"))
            stack.callback(made[-1].close)
        yield made


class SerialNodes:
    """The trusted nodes of n robots at the ends of as many lines: bti.nodes.Nodes for `sim`, on a bench."""

    def __init__(self, nodes: Sequence[SerialNode], n: int, limits: Limits) -> None:
        assert len(nodes) == n
        assert all(node.about.told_clock for node in nodes), "a simulation tells boards the time"
        self.profile = trusted.HARDENED
        self._nodes = nodes
        for node in nodes:
            node.make(limits)
        self.snode = elsewhere.register_remote(nodes)
        self.anode = self.snode

    def load_master(self, i: int, key: bytes, robot_id: int) -> None:
        """See bti.nodes.Nodes."""
        self._nodes[i].load_master(key, robot_id)

    def load_mission(self, i: int, now: int, sealed: MissionKey) -> None:
        """See bti.nodes.Nodes."""
        self._nodes[i].load_mission(now, sealed)

    def close(self) -> None:
        """All lines are closed, and kernels know these nodes no longer."""
        elsewhere.unregister_remote(self.snode)
        for node in self._nodes:
            node.close()


# Which call of the line each function of vectors/nodes.json is; a board has both nodes, and loads both at once.
CALLS = {
    "snode_load_master": lines.LOAD_MASTER,
    "snode_load_mission": lines.LOAD_MISSION,
    "snode_poll": lines.POLL,
    "anode_recv": lines.RECV,
    "anode_send": lines.SEND,
    "anode_actuate": lines.ACTUATE,
    "snode_make_auth": lines.MAKE_AUTH,
    "snode_check_auth": lines.CHECK_AUTH,
    "anode_token_request": lines.TOKEN_REQUEST,
    "anode_issue_token": lines.ISSUE_TOKEN,
    "anode_check_token": lines.CHECK_TOKEN,
    "anode_install_token": lines.INSTALL_TOKEN,
    "anode_check": lines.CHECK,
    "anode_is_safe": lines.CHECK,
}
TIMED = {each for name, each in CALLS.items() if name.endswith(("mission", "poll", "recv", "send", "actuate"))}
TIMED |= {lines.TOKEN_REQUEST, lines.INSTALL_TOKEN, lines.CHECK}
CODES = {reason.upper(): code for code, reason in REASONS.items()}
IN_ORDER = {  # where the vectors' numbers and byte strings stand among a call's fields
    lines.LOAD_MISSION: ("seq", "k", "r", "mac"),
    lines.LOAD_MASTER: ("id", "key"),
    lines.CHECK_AUTH: ("id", "top", "nonce", "mac"),
}


def live(robot: int, board: SerialNode, restart: Callable[[], SerialNode]) -> int:
    """A robot's part of the story in vectors/nodes.json, told over its board's serial line; `restart` is a power-up.

    How many calls were answered as the oracle has it: all.
    """
    cases = json.loads((ROOT / "vectors" / "nodes.json").read_text())["cases"]
    (story,) = [case for case in cases if case["profile"] == "hardened"]
    assert board.ask(lines.LIMITS, **story["limits"])[0] == 0
    done, before = 0, {}
    for k, told in enumerate(story["calls"]):
        if told["robot"] != robot:
            continue
        name = told["call"]
        kind, _, function = name.partition("node_")
        asked = (function, *told["numbers"], *told["bytes"])
        if kind == "a" and function.startswith(("load", "power")):
            assert before[asked] == told["expect"], "a board has one answer for both nodes"
            continue
        before[asked] = told["expect"]
        if function == "power_up":
            board = restart()
            continue
        call = CALLS[name]
        values = [*told["numbers"], *map(bytes.fromhex, told["bytes"])]
        now_ms = values.pop(0) if call in TIMED and told["numbers"] else None
        fields = IN_ORDER.get(call) or [field.name for field in call.fields[1:]]
        code, made = board.ask(call, now_ms, **dict(zip(fields, values, strict=True)))
        wanted = told["code"] if told["expect"] == "ok" else CODES[told["expect"]]
        if call in FORWARDED and told["expect"] == "ok":
            wanted = len(made)
        assert (code, made.hex()) == (wanted, told["out"]), f"{k}: {told}"
        done += 1
    return done
