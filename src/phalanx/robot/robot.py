"""One robot for callers in Python: events in, actions out, step by step, with the kernels of `handlers`.

Controllers in plain Python decide between the steps. Attacks override some of them (adversary/liar.py).
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

    Robots that run one after the other may share `work`. Without `make_controller` it runs the fleet's bundled one.

    Attributes:
        id: the robot's, 1..65535.
        profile: of the trusted nodes.
        raw: sensor data of which the next reading has only a hash; the caller sets it before `on_reading`.
        busy: its radio holds a fragment, so it must not send another.
        is_own: it runs a researcher's controller honestly, so its errors are reported as mistakes in their file.

    Source: docs/spec/rebound.md.
    """

    def __init__(self, fleet: Fleet, i: int, work: Work, make_controller: MakeController | None = None) -> None:
        self.f, self.i, self.w = fleet, i, work
        self.make_controller = make_controller
        # Asked for at every event: reading a record's field takes a microsecond.
        self.id, self.profile = int(fleet.robot[i].id), int(fleet.settings[0].profile)
        self._step_of, self._packet_max = fleet.robot["step"], int(fleet.settings[0].packet_max)
        self.controller = make_controller(self.id) if make_controller else None
        self.is_own = self.controller is not None
        self.raw = b""
        self.busy = False
        self._is_kept = True  # the fleet's memory has the controller's newest state

    # --- events ---

    def on_boot(self, now_ms: int) -> None:
        """Start: the mission key has just been loaded into both trusted nodes."""
        handlers.on_boot(self.f, self.i, now_ms)
        self.keep_state()

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """Handle a reading: the s-node chains it, the controller decides, and its outputs go out."""
        n = self.take(INPUT, now_ms, reading)
        return self.carry_out(now_ms, n) if n > 0 else []

    def on_advice(self, advice: bytes) -> None:
        """Log a planner's advice, and give it to the controller. At most once a reading, or logs fill."""
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
        """Begin a round: say HELLO, take a checkpoint, ask the first auditor; or listen first, without `listened`."""
        if listened:
            return self.begin_round(now_ms)
        asked, waits = self._done(handlers.listen, now_ms)
        return asked if waits else asked + self.begin_round(now_ms)

    def on_retry(self, now_ms: int) -> list[Action]:
        """Ask further robots if tokens are missing at the retry time."""
        asked, is_missing = self._done(handlers.seek, now_ms)
        return asked + self.next_packet(now_ms) if is_missing else asked

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        """Send the next fragment: the radio has sent the last one, or given it up."""
        if not arrived:
            seeking.give_up_request(self.f, self.i, now_ms, self.w.small[1])
        return self.next_packet(now_ms)

    # --- steps of these -----------------------------------------------------------------------------------------------

    def _done(self, step: Callable[..., Any], *args: int | Row) -> tuple[list[Action], int]:
        """Run a step of the handlers; return its actions, and the number that it returned."""
        actions.clear(self.w)
        returned = step(self.f, self.i, self.w, *args)
        return actions.decode(self.w), int(returned or 0)

    def take(self, kind: int, now_ms: int, payload: bytes) -> int:
        """Chain bytes in a trusted node, and log them; return the length of the entry in `work.entry`, or an error."""
        return int(handlers.take(self.f, self.i, self.w, kind, now_ms, row(payload), len(payload)))

    def record(self, raw: bytes | Row) -> None:
        """Log an entry or a mark, where there are logs."""
        if self.profile != PLAIN:
            log.append(self.f, self.i, row(bytes(raw)), len(raw))

    def carry_out(self, now_ms: int, entry_len: int) -> list[Action]:
        """Decide on the INPUT in `work.entry`, and pass the outputs through the a-node."""
        asked = (self.checked("send_output", self.send_output(now_ms, output)) for output in self.decide(entry_len))
        return [action for each in asked for action in each]

    def checked(self, method: str, asked: object) -> list[Action]:
        """Return what a method returned if that is actions: an attack may be a researcher's own.

        Raises: OwnMistake: it is not.
        """
        if isinstance(asked, list) and all(isinstance(each, Action) for each in asked):
            return asked
        wrong = next(each for each in asked if not isinstance(each, Action)) if isinstance(asked, list) else asked
        raise OwnMistake(f"{method} returned {kind_of(wrong)}", "a list of actions, empty for nothing", self, method)

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
        """Return what to keep of `raw`: nothing once the log is half full, because the rest is for unasked packets."""
        assert isinstance(self.controller, EvidenceController)
        kept = self.controller.keep(step, t_ms, reading, self.raw)
        if self.profile == PLAIN:
            return kept
        room = int(self.f.settings[0].log_max) // 2 - int(self.f.robot[self.i].log_len)
        fits = log.EVIDENCE_HEAD_BYTES + len(kept) <= room and len(kept) <= self.w.evidence.shape[0]
        return kept if fits else b""

    def keep_evidence(self, evidence: bytes) -> None:
        """Log the evidence, right behind its INPUT."""
        if evidence:
            self.record(table.EVIDENCE.encode(bytes=evidence))

    def send_output(self, now_ms: int, output: Send | Act) -> list[Action]:
        """Pass one output through the a-node."""
        if isinstance(output, Send):
            return self.send(now_ms, output.payload, EVERYBODY)
        return self.act(now_ms, output.payload)

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        """Pass a command through the a-node, and log it."""
        return self._done(handlers.act, now_ms, row(command), len(command))[0]

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        """Pass a packet through the a-node, and log it unless it is audit traffic."""
        asked, n = self._done(handlers.send, now_ms, row(packet), len(packet), to)
        if n == trusted.E_AIRTIME and self.is_own and not packet[0] & request.AUDIT:
            # Otherwise its auditors would stop it for a missing output, without a hint at the reason.
            raise OwnMistake(
                f"robot {self.id}: its a-node has no airtime left for a packet of {len(packet)} bytes",
                "shorter packets, or fewer: in each state period as much airtime as four of 27 bytes",
                self.controller,
            )
        return asked

    def answer(self, now_ms: int, place: int, auditee: int, refusal: int) -> list[Action]:
        """End the audit of the request at `place`."""
        return self._done(handlers.answer, now_ms, place, auditee, refusal)[0]

    def begin_round(self, now_ms: int) -> list[Action]:
        """Open a round: say HELLO, and ask the first auditor."""
        return self._done(handlers.begin_round, now_ms)[0] + self.next_packet(now_ms)

    def next_packet(self, now_ms: int) -> list[Action]:
        """Send the next fragment of an audit request, or say when to retry."""
        if self.busy:
            return []
        n = request.next_fragment(self.f, self.i, now_ms, self.w.packet)
        if n == 0 and self.make_request(now_ms):
            n = request.next_fragment(self.f, self.i, now_ms, self.w.packet)
        return self._done(handlers.ask_with, now_ms, n)[0]

    def make_request(self, now_ms: int) -> bool:
        """Make a request for an audit in `fleet.request`; return whether there is one."""
        self.flush_state()  # its checkpoint is made now
        return bool(request.make_request(self.f, self.i, now_ms, *self.w.small[:3]) > 0)

    # --- plain-Python controllers ---

    def keep_state(self) -> None:
        """Write the state of a controller in plain Python to the fleet's memory, from which checkpoints are made."""
        # A mission's state is long, and without audits nothing reads it.
        unasked = self.profile == PLAIN and isinstance(self.controller, EvidenceController)
        if self.controller and not unasked:
            room = self.f.checkpoint.shape[2] - CHECKPOINT_BYTES
            state = checked_state(self.controller.encode(), room, self.controller)
            self.f.state[self.i, : len(state)] = np.frombuffer(state, np.uint8)
            self.f.robot[self.i].state_len = len(state)
        self._is_kept = True

    def flush_state(self) -> None:
        """Write the controller's state to the fleet's memory, unless it is there."""
        if not self._is_kept:
            self.keep_state()

    def _judge(self, place: int, src: int) -> int:
        """Audit as `handlers.audit_request` does, with the mission's plain-Python controller."""
        info = self.f.rx_info[self.i, place]
        q, length = self.f.rx.rows[info.row], int(info.len)
        try:
            with reading_peer():
                refused = audit.examine(self.f, self.i, self.w, q, length, src) or self._replay(q)
        except Defective:
            refused = Refusal.DEFECT
        except Exception:  # noqa: BLE001 - whatever a log makes a researcher's controller raise, it earns no token
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
