"""One robot for callers in Python: events in, actions out.

A robot with a bundled controller runs whole handlers of `node`. One with a controller in plain Python runs their steps,
with the controller in between. Attacks wrap a robot and use the same steps (attacks/wrapper.py).
Source: RoboRebound §3; docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phalanx.bti import audit, log, memo, request, trusted
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

from . import actions, chained, handlers
from .actions import EVERYBODY, Action
from .controllers.python_controller import (
    Act,
    Controller,
    EvidenceController,
    OwnMistake,
    Send,
    checked_outputs,
    checked_state,
    unpack_outputs,
)
from .replay import decide, replay, show_state


class Robot:
    """Robot `i` of a fleet.

    Robots that run one after the other may share `work`. Without `make_controller` it runs the fleet's bundled one.

    Attributes:
        id: the robot's, 1..65535.
        profile: of the trusted nodes.
        raw: what the next reading carries only a hash of; whoever polls the sensors sets it before `on_reading`.
        busy: its radio holds a fragment, so that no other is to be sent.
        is_own: it runs a researcher's controller honestly, so that what goes wrong is reported as a mistake of theirs.

    Source: docs/spec/rebound.md.
    """

    def __init__(
        self, fleet: Fleet, i: int, work: Work, make_controller: Callable[[int], Controller] | None = None
    ) -> None:
        self.f, self.i, self.w = fleet, i, work
        self.make_controller = make_controller
        # Asked for at every event: reading a record's field takes a microsecond.
        self.id, self.profile = int(fleet.robot[i].id), int(fleet.settings[0].profile)
        self._step_of, self._frame_max = fleet.robot["step"], int(fleet.settings[0].frame_max)
        self.controller = make_controller(self.id) if make_controller else None
        self.is_own = self.controller is not None
        self.raw = b""
        self.busy = False
        self._is_kept = True  # what its controller remembers, where checkpoints are made from

    # --- events ---

    def on_boot(self, now_ms: int) -> None:
        """The mission key has just been loaded into both trusted nodes."""
        handlers.on_boot(self.f, self.i, now_ms)
        self.keep_state()

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """The sensors were read: the s-node is polled, the controller decides, its outputs go out."""
        if self.controller is None:
            handlers.on_reading(self.f, self.i, self.w, now_ms, row(reading), len(reading))
            return actions.decode(self.w)
        n = self.take(INPUT, now_ms, reading)
        return [action for output in self.decide(n) for action in self.put_out(now_ms, output)] if n > 0 else []

    def on_advice(self, advice: bytes) -> None:
        """A planner has advised: log it, and give it to the controller. At most once a reading, or logs fill."""
        if self.profile != PLAIN:
            marked = guarded.ADVICE.encode(bytes=advice)
            log.append(self.f, self.i, row(marked), len(marked))
        if self.controller:
            self.controller.on_advice(advice)
            self.keep_state()
        else:
            handlers.on_advice(self.f, self.i, row(advice), len(advice))

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        """A packet has arrived at the a-node."""
        heard = handlers.on_packet(self.f, self.i, self.w, now_ms, row(packet), len(packet))
        if heard == handlers.HEARD and self.controller:
            self.controller.on_recv(self._entry_time(), packet)
            self._is_kept = False
        elif heard == handlers.WHOLE:
            place, src = int(self.w.told[handlers.TOLD_PLACE]), int(self.w.told[handlers.TOLD_TEE])
            return self.answer(now_ms, place, src, self._judge(place, src))
        return actions.decode(self.w)

    def on_round(self, now_ms: int, *, listened: bool) -> list[Action]:
        """T_audit has passed, or the robot has listened since: say HELLO, take a checkpoint, ask the first auditor."""
        self.bring_up()
        handlers.on_round(self.f, self.i, self.w, now_ms, listened, self.busy)
        return actions.decode(self.w)

    def on_retry(self, now_ms: int) -> list[Action]:
        """The retry time has passed: ask further robots if tokens are missing."""
        self.bring_up()
        handlers.on_retry(self.f, self.i, self.w, now_ms, self.busy)
        return actions.decode(self.w)

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        """The radio is done with the last fragment."""
        self.bring_up()
        handlers.on_sent(self.f, self.i, self.w, now_ms, arrived, self.busy)
        return actions.decode(self.w)

    # --- steps of these, for attacks and controllers in Python --------------------------------------------------------

    def take(self, kind: int, now_ms: int, payload: bytes) -> int:
        """Chain bytes in a trusted node, and log them; return the length of the entry in `work.entry`, or an error."""
        return int(chained.take(self.f, self.i, self.w, kind, now_ms, row(payload), len(payload)))

    def decide(self, entry_len: int) -> list[Send | Act]:
        """Return the controller's outputs for the INPUT in `work.entry`."""
        if self.controller is None:
            n = handlers.think(self.f, self.i, self.w, entry_len)
            return unpack_outputs(self.w.out[:n].tobytes())
        reading = self.w.entry[ENTRY_HEAD_BYTES:entry_len].tobytes()
        step, t_ms = self.step, self._entry_time()
        evidence = b""
        if isinstance(self.controller, EvidenceController):
            evidence = self.evidence(step, t_ms, reading)
            self.keep_evidence(evidence)
        outputs = decide(self.controller, step, t_ms, reading, evidence)
        self._step_of[self.i] += 1
        self._is_kept = False
        if not self.controller.is_ours:  # what it does wrong is told at once
            self.keep_state()
        return checked_outputs(outputs, self._frame_max, self.controller)

    @property
    def step(self) -> int:
        """How many readings it has had."""
        return int(self._step_of[self.i])

    def evidence(self, step: int, t_ms: int, reading: bytes) -> bytes:
        """What to keep of `raw`: nothing if the log is half full, as the rest is for what comes without being asked."""
        assert isinstance(self.controller, EvidenceController)
        kept = self.controller.keep(step, t_ms, reading, self.raw)
        if self.profile == PLAIN:
            return kept
        room = int(self.f.settings[0].log_max) // 2 - int(self.f.robot[self.i].log_len)
        fits = log.EVIDENCE_HEAD_BYTES + len(kept) <= room and len(kept) <= self.w.evidence.shape[0]
        return kept if fits else b""

    def keep_evidence(self, evidence: bytes) -> None:
        """Log the evidence, right behind its INPUT."""
        if evidence and self.profile != PLAIN:
            marked = table.EVIDENCE.encode(bytes=evidence)
            log.append(self.f, self.i, row(marked), len(marked))

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        """Pass one output through the a-node."""
        if isinstance(output, Send):
            return self.send(now_ms, output.payload, EVERYBODY)
        return self.act(now_ms, output.payload)

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        """Pass a command through the a-node, and log it."""
        actions.clear(self.w)
        handlers.act(self.f, self.i, self.w, now_ms, row(command), len(command))
        return actions.decode(self.w)

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        """Pass a packet through the a-node, and log it unless it is audit traffic."""
        actions.clear(self.w)
        n = handlers.send(self.f, self.i, self.w, now_ms, row(packet), len(packet), to)
        if n == trusted.E_AIRTIME and self.is_own and not packet[0] & request.AUDIT:
            # Else it would be stopped for an output that its log lacks, and nobody would know why.
            raise OwnMistake(
                f"robot {self.id}: its a-node has no airtime left for a frame of {len(packet)} bytes",
                "shorter frames, or fewer: in each state period as much airtime as four of 27 bytes",
                self.controller,
            )
        return actions.decode(self.w)

    def answer(self, now_ms: int, place: int, auditee: int, refusal: int) -> list[Action]:
        """End the audit of the request at `place`."""
        actions.clear(self.w)
        handlers.answer(self.f, self.i, self.w, now_ms, place, auditee, refusal)
        return actions.decode(self.w)

    def listen(self, now_ms: int) -> tuple[list[Action], bool]:
        """Return when the next round is, and whether this one waits until the robot has listened."""
        actions.clear(self.w)
        waits = handlers.listen(self.f, self.i, self.w, now_ms)
        return actions.decode(self.w), bool(waits)

    def begin_round(self, now_ms: int) -> list[Action]:
        """Open a round, and say HELLO."""
        actions.clear(self.w)
        handlers.begin_round(self.f, self.i, self.w, now_ms)
        return actions.decode(self.w)

    def seek(self, now_ms: int) -> tuple[list[Action], bool]:
        """Ask again who is there, if that is due; return whether tokens are missing."""
        actions.clear(self.w)
        is_missing = handlers.seek(self.f, self.i, self.w, now_ms)
        return actions.decode(self.w), bool(is_missing)

    def not_arrived(self, now_ms: int) -> None:
        """Note that the last fragment did not arrive."""
        request.not_arrived(self.f, self.i, now_ms)

    def next_fragment(self, now_ms: int) -> int:
        """Write the next fragment of the request under way to `work.frame`; return its length, 0 if there is none."""
        return int(request.next_fragment(self.f, self.i, now_ms, self.w.frame))

    def make_request(self, now_ms: int) -> bool:
        """Make a request for an audit in `fleet.request`; return whether there is one."""
        self.bring_up()  # its checkpoint is made now
        return bool(request.make_request(self.f, self.i, now_ms, *self.w.small[:3]) > 0)

    def ask_with(self, now_ms: int, length: int) -> list[Action]:
        """Send the fragment in `work.frame`; without one, say when to retry."""
        actions.clear(self.w)
        handlers.ask_with(self.f, self.i, self.w, now_ms, length)
        return actions.decode(self.w)

    # --- plain-Python controllers ---

    def _entry_time(self) -> int:
        return int(get_u32(self.w.entry, ENTRY_T))

    def keep_state(self) -> None:
        """Write what a controller in plain Python remembers to where checkpoints are made from."""
        # A mission's is long, and nobody asks for it where nobody audits.
        unasked = self.profile == PLAIN and isinstance(self.controller, EvidenceController)
        if self.controller and not unasked:
            room = self.f.checkpoint.shape[2] - CHECKPOINT_BYTES
            state = checked_state(self.controller.encode(), room, self.controller)
            self.f.state[self.i, : len(state)] = np.frombuffer(state, np.uint8)
            self.f.robot[self.i].state_len = len(state)
        self._is_kept = True

    def bring_up(self) -> None:
        """Its state in the fleet's memory is up to date, for a checkpoint or for whoever looks there."""
        if not self._is_kept:
            self.keep_state()

    def _judge(self, place: int, src: int) -> int:
        """As `handlers.judge`, with the mission's plain-Python controller."""
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
        controller = self.make_controller(int(case.tee))
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
