"""Convert a robot's kept log to a recording (MCAP) that others can open, and back.

Each entry is a message of /entries, timed by the robot's own clock since its mission key. The metadata `robot` contains
the first line of the kept log, which describes the mission.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phalanx.bti.log import ADVICE, CHECKPOINT, EVIDENCE, FLUSH_A, FLUSH_S
from phalanx.config.written import read_at_most
from phalanx.errors import PhalanxError, UsageError
from phalanx.recording.recorded import CUT_SHORT, is_recording, read_recording
from phalanx.recording.recorder import NS, Recorder
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.retrace import Entry, Finding, entries_of, first_dishonest_entry
from phalanx.scenarios.behaviour import params_of, with_protocol
from phalanx.scenarios.file import parse_scenario, written_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import ENTRY_ACMD, ENTRY_INPUT, ENTRY_RECV, ENTRY_SEND, PROOF

from .signed_mission import SignedMission

MOST_BYTES, MOST_UNPACKED = 1 << 26, 1 << 29
HINT = "use a file that phalanx robot log wrote"
KINDS = {
    ENTRY_INPUT: "input",
    ENTRY_RECV: "recv",
    ENTRY_SEND: "send",
    ENTRY_ACMD: "acmd",
    ADVICE: "advice",
    EVIDENCE: "evidence",
    CHECKPOINT: "checkpoint",
    FLUSH_S: "flush s",
    FLUSH_A: "flush a",
    PROOF.tag: "proof",
}
ENTRY_SCHEMA = {
    "title": "phalanx.Entry",
    "type": "object",
    "properties": {
        "entry": {"type": "integer"},
        "kind": {"enum": list(KINDS.values())},
        "t_ms": {"type": "integer"},
        "bytes": {"type": "string"},
    },
}


@dataclass(frozen=True, slots=True)
class RobotLog:
    """One robot's kept log of a mission, from the mission key on."""

    robot: int
    mission: int
    t_key_ms: int
    scenario: Scenario
    raw: bytes  # with proofs of the trusted nodes in between
    signed: SignedMission | None = None

    def plain(self) -> bytes:
        """Return the log without the trusted nodes' proofs."""
        return b"".join(self.raw[each.at : each.end] for each in self.entries())

    def first_dishonest_entry(self, controller: Callable[[int], Controller] | None = None) -> Finding | None:
        """Return the first entry that an honest robot would not have logged, or None.

        `controller` creates the user's own controller, if the robot ran one. Source: RoboRebound §3.7.
        """
        scenario, made, _ = with_protocol(self.scenario, controller)
        if not made:
            made = compiled(dispatch.NUMBERS[scenario.controller], params_of(scenario, self.mission))
        return first_dishonest_entry(self.plain(), self.robot, self.t_key_ms, scenario.bti, made, scenario.seed)

    @property
    def head(self) -> dict[str, Any]:
        """Return the first line of the log."""
        head: dict[str, Any] = {"robot": self.robot, "mission": self.mission, "t_key_ms": self.t_key_ms}
        head |= {"signed": self.signed.as_json} if self.signed else {}
        return head | {"scenario": written_scenario(self.scenario)}

    @property
    def mission_signer(self) -> str:
        """Return the public key (hex) that signed this mission; "" if it is unsigned or another is signed."""
        return self.signed.signer if self.signed and self.signed.is_of(self.scenario, self.mission) else ""

    def entries(self) -> list[Entry]:
        """Return the entries in order, as in `raw`."""
        return [each for each in entries_of(self.raw) if each.kind != PROOF.tag]


def read_robot_log(path: Path) -> RobotLog:
    """Return the log in a daemon's file or a recording; recordings that were cut short are refused.

    Raises: UsageError: it is neither, damaged or cut short; Unavailable: it cannot be read.
    """
    data = read_at_most(path, MOST_BYTES, HINT)
    try:
        line, _, raw = data.partition(b"\n")
        head, raw = _of_recording(path) if is_recording(path) else (json.loads(line), raw)
        scenario = parse_scenario(json.dumps(head["scenario"]).encode(), str(path))
        signed = SignedMission.of(head.get("signed"))
        kept = RobotLog(int(head["robot"]), int(head["mission"]), int(head["t_key_ms"]), scenario, raw, signed)
    except PhalanxError:
        raise
    except Exception as error:  # parsers raise various exceptions
        raise UsageError(f"{path} is not a robot's log", HINT) from error
    if not (1 <= kept.robot <= scenario.robots and 0 <= kept.t_key_ms < 1 << 32):
        raise UsageError(f"the robot of {path} is not in its mission", HINT)
    return kept


def _of_recording(path: Path) -> tuple[dict[str, Any], bytes]:
    head, raw = None, bytearray()
    for message in read_recording(path, HINT, MOST_UNPACKED):
        if message.topic == CUT_SHORT:
            raise UsageError(f"{path} was cut short", HINT)
        if message.topic == "metadata robot":
            head = json.loads(message.words["head"])
        elif message.topic == "/entries":
            raw += bytes.fromhex(message.words["bytes"])
        if len(raw) > MOST_BYTES:
            raise UsageError(f"{path} is longer than a log", HINT)
    if head is None:
        raise KeyError("robot")
    return head, bytes(raw)


class LogRecording(Recorder):
    """Writes a kept log to a recording."""

    def __init__(self, path: Path, kept: RobotLog) -> None:
        super().__init__(path)
        self._kept = kept

    def _begin(self) -> None:
        self._channel("/entries", "json", str(ENTRY_SCHEMA["title"]), "jsonschema", json.dumps(ENTRY_SCHEMA).encode())
        self._writer.add_metadata("robot", {"head": json.dumps(self._kept.head)})

    def write(self) -> int:
        """Write all entries; return their number, with proofs. Raises: Unavailable: the disk is full."""
        now_ms = self._kept.t_key_ms
        number = 0  # of an entry; a proof has that of the next entry
        entries = list(entries_of(self._kept.raw))
        for each in entries:
            now_ms = max(now_ms, each.t_ms)  # marks have the time of the entry before them
            fields = {"entry": number, "kind": KINDS.get(each.kind, "unknown"), "t_ms": now_ms}
            number += each.kind != PROOF.tag
            fields["bytes"] = self._kept.raw[each.at : each.end].hex()
            self.put("/entries", (now_ms - self._kept.t_key_ms) * NS // 1000, fields)
        return len(entries)


def record_log(log_file: Path, out: Path) -> int:
    """Convert a daemon's log to a recording, and return the number of entries. Raises: UsageError, Unavailable."""
    with LogRecording(out, read_robot_log(log_file)) as recording:
        return recording.write()
