"""One robot for callers in Python: events in, actions out, with the kernels of `handlers`.

Controllers in plain Python run between these kernels. Attacks override some of the methods (adversary/liar.py).
Source: RoboRebound §3; docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from phalanx.bti import audit, log, memo, request, seeking, trusted
from phalanx.bti.audit import INPUT
from phalanx.bti.fleet import PLAIN, Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_T
from phalanx.bti.refusal import Refusal
from phalanx.bti.rounds import CHECKPOINT_BYTES
from phalanx.bti.work import Work
from phalanx.errors import Defective, PeerError
from phalanx.kernel import reading_peer
from phalanx.wire import guarded, table
from phalanx.wire.fields import Row, get_u32, row

from . import actions, handlers
from .actions import EVERYBODY, Action
from .controllers.python_controller import (
    Act,
    Controller,
    EvidenceController,
    OwnMistake,
    Send,
    checked_outputs,
    checked_state,
    kind_of,
    unpack_outputs,
)
from .replay import decide, replay, show_state

MakeController: TypeAlias = Callable[[int], Controller]


class Robot:
    """Robot `i` of a fleet.

    Robots that never run at the same time may share `work`. Without `make_controller` the robot runs the fleet's
    bundled controller.

    Attributes:
        id: the robot's id, 1..65535.
        profile: profile of the trusted nodes.
        raw: sensor data of which the next reading has only a hash; the caller sets it before `on_reading`.
        busy: whether the radio is sending a fragment, so that the robot must not send another.
        is_own: whether it honestly runs a user's controller, so that errors are reported as mistakes in that file.

    Source: docs/spec/rebound.md.
    """

    def __init__(self, fleet: Fleet, i: int, work: Work, make_controller: MakeController | None = None) -> None:
        self.f, self.i, self.w = fleet, i, work
        self.make_controller = make_controller
        # Cached, because each event needs them, and reading a record's field takes a microsecond.
        self.id, self.profile = int(fleet.robot[i].id), int(fleet.settings[0].profile)
        self._step_of, self._packet_max = fleet.robot["step"], int(fleet.settings[0].packet_max)
        self.controller = make_controller(self.id) if make_controller else None
        self.is_own = self.controller is not None
        self.raw = b""
        self.busy = False
        self._is_kept = True  # whether the fleet's memory has the controller's newest state

    # --- events ---

    def on_boot(self, now_ms: int) -> None:
        """Start: the mission key has just been loaded into both trusted nodes."""
        handlers.on_boot(self.f, self.i, now_ms)
        self.keep_state()

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """Handle a reading: the s-node chains it, the controller runs, and its outputs are sent."""
        n = self.take(INPUT, now_ms, reading)
        return self.carry_out(now_ms, n) if n > 0 else []

    def on_advice(self, advice: bytes) -> None:
        """Log a planner's advice, and pass it to the controller; call it at most once per reading, or logs fill up."""
        self.record(guarded.ADVICE.encode(bytes=advice))
        if self.controller:
            self.controller.on_advice(advice)
            self.keep_state()
        else:
            handlers.on_advice(self.f, self.i, row(advice), len(advice))

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        """Handle a packet that the radio received."""
        heard = handlers.on_packet(self.f, self.i, self.w, now_ms, row(packet), len(packet))
        if heard == handlers.HEARD and self.controller:
            self.controller.on_recv(int(get_u32(self.w.entry, ENTRY_T)), packet)
            self._is_kept = False
        elif heard == handlers.WHOLE:
            place, src = int(self.w.place[0]), int(self.w.case[0].auditee)
            return self.answer(now_ms, place, src, self._judge(place, src))
        return actions.decode(self.w)

    def on_round(self, now_ms: int, *, listened: bool) -> list[Action]:
        """Begin a round: send HELLO, take a checkpoint, ask an auditor. Unless `listened`, it may listen first."""
        if listened:
            return self.begin_round(now_ms)
        todo, waits = self._run(handlers.listen, now_ms)
        return todo if waits else todo + self.begin_round(now_ms)

    def on_retry(self, now_ms: int) -> list[Action]:
        """Ask further robots if tokens are missing at the retry time."""
        todo, is_missing = self._run(handlers.seek, now_ms)
        return todo + self.next_packet(now_ms) if is_missing else todo

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        """Send the next fragment, after the radio has sent or dropped the last one."""
        if not arrived:
            seeking.give_up_request(self.f, self.i, now_ms, self.w.small[1])
        return self.next_packet(now_ms)

    # --- steps of these -----------------------------------------------------------------------------------------------

    def _run(self, step: Callable[..., Any], *args: int | Row) -> tuple[list[Action], int]:
        """Run a kernel of `handlers`; return its actions and its result."""
        actions.clear(self.w)
        returned = step(self.f, self.i, self.w, *args)
        return actions.decode(self.w), int(returned or 0)

    def take(self, kind: int, now_ms: int, payload: bytes) -> int:
        """Chain bytes in a trusted node, and log them; return the length of the entry in `work.entry`, or an error."""
        return int(handlers.take(self.f, self.i, self.w, kind, now_ms, row(payload), len(payload)))

    def record(self, raw: bytes | Row) -> None:
        """Log an entry or a mark, unless the robot has no log."""
        if self.profile != PLAIN:
            log.append(self.f, self.i, row(bytes(raw)), len(raw))

    def carry_out(self, now_ms: int, entry_len: int) -> list[Action]:
        """Run the controller on the INPUT in `work.entry`, and pass its outputs through the a-node."""
        todo = (self.checked("send_output", self.send_output(now_ms, output)) for output in self.decide(entry_len))
        return [action for each in todo for action in each]

    def checked(self, method: str, returned: object) -> list[Action]:
        """Return the result of a method, which may be that of a user's attack, if it is a list of actions.

        Raises: OwnMistake: it is not.
        """
        if isinstance(returned, list) and all(isinstance(each, Action) for each in returned):
            return returned
        wrong = returned
        if isinstance(returned, list):
            wrong = next(each for each in returned if not isinstance(each, Action))
        raise OwnMistake(f"{method} returned {kind_of(wrong)}", "return a list of actions, or []", self, method)

    def decide(self, entry_len: int) -> list[Send | Act]:
        """Return the controller's outputs for the INPUT in `work.entry`."""
        if self.controller is None:
            n = handlers.run_controller(self.f, self.i, self.w, entry_len)
            return unpack_outputs(self.w.out[:n].tobytes())
        reading = self.w.entry[ENTRY_HEAD_BYTES:entry_len].tobytes()
        step, t_ms = int(self._step_of[self.i]), int(get_u32(self.w.entry, ENTRY_T))
        evidence = b""
        if isinstance(self.controller, EvidenceController):
            evidence = self.evidence(step, t_ms, reading)
            self.keep_evidence(evidence)
        outputs = decide(self.controller, step, t_ms, reading, evidence)
        self._step_of[self.i] += 1
        self._is_kept = False
        if not self.controller.is_ours:  # report its mistakes at once
            self.keep_state()
        return checked_outputs(outputs, self._packet_max, self.controller)

    def evidence(self, step: int, t_ms: int, reading: bytes) -> bytes:
        """Return the evidence from `raw`; none once the log is half full: the rest is for packets of other robots."""
        assert isinstance(self.controller, EvidenceController)
        kept = self.controller.keep(step, t_ms, reading, self.raw)
        if self.profile == PLAIN:
            return kept
        room = int(self.f.settings[0].log_max) // 2 - int(self.f.robot[self.i].log_len)
        fits = log.EVIDENCE_HEAD_BYTES + len(kept) <= room and len(kept) <= self.w.evidence.shape[0]
        return kept if fits else b""

    def keep_evidence(self, evidence: bytes) -> None:
        """Log the evidence, right after its INPUT."""
        if evidence:
            self.record(table.EVIDENCE.encode(bytes=evidence))

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        """Pass one output through the a-node."""
        if isinstance(output, Send):
            return self.send(now_ms, output.payload, EVERYBODY)
        return self.act(now_ms, output.payload)

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        """Pass a command through the a-node, and log it."""
        return self._run(handlers.act, now_ms, row(command), len(command))[0]

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        """Pass a packet through the a-node, and log it unless it is audit traffic."""
        todo, n = self._run(handlers.send, now_ms, row(packet), len(packet), to)
        if n == trusted.E_AIRTIME and self.is_own and not packet[0] & request.AUDIT:
            # Otherwise auditors would stop the robot for a missing output, and the user would not learn the reason.
            raise OwnMistake(
                f"robot {self.id}: the a-node has no airtime left for a packet of {len(packet)} bytes",
                "send less: the limit per state period is the airtime of four packets of 27 bytes",
                self.controller,
            )
        return todo

    def answer(self, now_ms: int, place: int, auditee: int, refusal: int) -> list[Action]:
        """Record the verdict on the request at `place`, and send the token if it passed."""
        return self._run(handlers.answer, now_ms, place, auditee, refusal)[0]

    def begin_round(self, now_ms: int) -> list[Action]:
        """Start a round: send HELLO, and ask the first auditor."""
        return self._run(handlers.begin_round, now_ms)[0] + self.next_packet(now_ms)

    def next_packet(self, now_ms: int) -> list[Action]:
        """Send the next fragment of an audit request, or set the time of the next retry."""
        if self.busy:
            return []
        n = request.next_fragment(self.f, self.i, now_ms, self.w.packet)
        if n == 0 and self.make_request(now_ms):
            n = request.next_fragment(self.f, self.i, now_ms, self.w.packet)
        return self._run(handlers.ask_with, now_ms, n)[0]

    def make_request(self, now_ms: int) -> bool:
        """Write an audit request to `fleet.request`; return whether one was due."""
        self.flush_state()  # make_request takes the checkpoint
        return bool(request.make_request(self.f, self.i, now_ms, *self.w.small[:3]) > 0)

    # --- plain-Python controllers ---

    def keep_state(self) -> None:
        """Write the state of a controller in plain Python to the fleet's memory, from which checkpoints are taken."""
        # Skip the long state of a mission in robots without audits, where nothing reads it.
        unasked = self.profile == PLAIN and isinstance(self.controller, EvidenceController)
        if self.controller and not unasked:
            room = self.f.checkpoint.shape[2] - CHECKPOINT_BYTES
            state = checked_state(self.controller.encode(), room, self.controller)
            self.f.state[self.i, : len(state)] = np.frombuffer(state, np.uint8)
            self.f.robot[self.i].state_len = len(state)
        self._is_kept = True

    def flush_state(self) -> None:
        """Write the controller's state to the fleet's memory, unless that is up to date."""
        if not self._is_kept:
            self.keep_state()

    def _judge(self, place: int, src: int) -> int:
        """Audit a request as `handlers.audit_request` does, but with a controller in plain Python."""
        info = self.f.rx_info[self.i, place]
        q, length = self.f.rx.rows[info.row], int(info.len)
        try:
            with reading_peer():
                refused = audit.examine(self.f, self.i, self.w, q, length, src) or self._replay(q)
        except Defective:
            refused = Refusal.DEFECT
        except Exception:  # noqa: BLE001 - a log that makes a user's controller raise gets no token
            refused = Refusal.CONTROLLER_FAILED
        return int(refused)

    def _replay(self, q: Row) -> int:
        assert self.make_controller
        case, w = self.w.case[0], self.w
        controller = self.make_controller(int(case.auditee))
        known = int(case.known)
        if known or q[request.AT_FLAGS] == 0:
            end = CHECKPOINT_BYTES + int(case.state_len) if known else int(case.start_len)
            try:
                controller.decode(w.state[CHECKPOINT_BYTES:end].tobytes())
            except PeerError:
                return int(Refusal.STATE_MALFORMED)
        refused = replay(self.f, w, q, controller)
        if not refused and controller.is_ours and not self.f.settings[0].plain:
            case.state_len = show_state(w, controller)
            memo.remember(self.f.memo, w, q, known)
        return refused
