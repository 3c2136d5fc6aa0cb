"""The c-node as an object: events in, what the a-node let through out. A pure state machine.

Fleets run the kernels of `node` inside compiled code. This class runs the same kernels one event at a time, for robots
that need Python at some point: a researcher's controller, a lying robot (`attacks` overrides its methods), a daemon.
Source: RoboRebound §3; docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

import numpy as np

from phalanx.bti import audit, log, memo, request, rounds, trusted
from phalanx.bti.audit import ACMD, INPUT, SEND
from phalanx.bti.fleet import PLAIN, Fleet
from phalanx.bti.log import ENTRY_HEAD_BYTES, ENTRY_T
from phalanx.bti.refusal import Refusal
from phalanx.bti.rounds import CHECKPOINT_BYTES
from phalanx.bti.work import CASE, Work
from phalanx.errors import Defective, PeerError
from phalanx.kernel import reading_peer
from phalanx.wire import guarded, table
from phalanx.wire.fields import Row, get_u32, row

from . import node
from .controllers.evidence_controller import EvidenceController
from .controllers.python_controller import (
    Act,
    Controller,
    OwnMistake,
    Send,
    checked_outputs,
    checked_state,
    kind_of,
    pack_outputs,
    unpack_outputs,
)

EVERYBODY: Final = -1
# What a replay reads of each event. A record of numpy takes 2 us for a field, and all of them as a tuple 0.2.
_EVENT: Final = itemgetter(
    *map(list(CASE.fields or ()).index, ("payload_at", "payload_len", "entry_t", "step", "evidence_len"))
)


@dataclass(frozen=True, slots=True)
class Transmit:
    """A frame the a-node passed to the radio, for one robot's id or EVERYBODY."""

    frame: bytes
    to: int


@dataclass(frozen=True, slots=True)
class Actuate:
    """A command the a-node passed to the actuators."""

    command: bytes


@dataclass(frozen=True, slots=True)
class Retry:
    """Call `on_retry` at this moment of the robot's clock."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class Verdict:
    """An audit of ours is over; `refusal` is NONE if a token was issued."""

    auditee: int
    refusal: Refusal


Action = Transmit | Actuate | Retry | Verdict


class CNode:
    """Robot `i` of a fleet, honest; subclasses lie.

    Robots that run one after the other may share `work`. No `make_controller`: it runs the fleet's bundled one.

    Attributes:
        id: the robot's, 1..65535.
        profile: of the trusted nodes.
        raw: what the next reading carries only a hash of; whoever polls the sensors sets it before `on_sensor`.

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
        self.raw = b""
        self._is_kept = True  # what its controller remembers, where checkpoints are made from

    @property
    def is_own(self) -> bool:
        """Whether it runs a researcher's controller, and honestly."""
        return self.controller is not None and type(self) is CNode

    # --- events ---

    def on_boot(self, now_ms: int) -> list[Action]:
        """The mission key has just been loaded into both trusted nodes."""
        node.boot(self.f, self.i, now_ms)
        self.keep_state()
        return []

    def on_sensor(self, now_ms: int, reading: bytes) -> list[Action]:
        """A reading is due: the s-node is polled, the controller decides, its outputs go out."""
        n = node.take(self.f, self.i, self.w, INPUT, now_ms, row(reading), len(reading))
        if n <= 0:
            return []
        return self.carry_out(now_ms, n)

    def on_advice(self, advice: bytes) -> None:
        """A planner said something: it is logged, and the controller is told. At most once a reading, or logs fill."""
        if self.profile != PLAIN:
            marked = guarded.ADVICE.encode(bytes=advice)
            log.append(self.f, self.i, row(marked), len(marked))
        if self.controller:
            self.controller.on_advice(advice)
            self.keep_state()
        else:
            node.advise(self.f, self.i, row(advice), len(advice))

    def on_message(self, now_ms: int, frame: bytes) -> list[Action]:
        """A frame has arrived at the a-node."""
        told = node.hear(self.f, self.i, self.w, now_ms, row(frame), len(frame))
        if self.controller and told == node.NOTHING and not frame[0] & request.AUDIT:
            self.controller.on_recv(self._entry_time(), frame)
            self._is_kept = False
        if told == node.WHOLE:
            place, src = int(self.w.told[node.TOLD_PLACE]), int(self.w.told[node.TOLD_TEE])
            told = int(node.answer(self.f, self.i, self.w, place, src, self._judge(place, src)))
        if told == node.HELLO:
            return self._tell(now_ms, int(self.w.told[node.TOLD_TO]))
        return self.judged(now_ms) if told == node.REPLY else []

    def on_round(self, now_ms: int) -> list[Action]:
        """T_audit has passed: say hello, take a checkpoint, ask the first auditor."""
        rounds.begin_round(self.f, self.i)
        n = request.hello(self.f, self.i, now_ms, self.w.frame)
        return self.send(now_ms, self.w.frame[:n].tobytes(), EVERYBODY) + self.next_frame(now_ms)

    def on_retry(self, now_ms: int) -> list[Action]:
        """The retry time has passed: ask further robots if tokens are missing."""
        if rounds.retry(self.f, self.i) == 0:
            return []
        n = request.seek(self.f, self.i, now_ms, self.w.frame)
        said = self.send(now_ms, self.w.frame[:n].tobytes(), EVERYBODY) if n else []
        return said + self.next_frame(now_ms)

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        """The radio is done with the last fragment."""
        if not arrived:
            request.not_arrived(self.f, self.i, now_ms)
        return self.next_frame(now_ms)

    # --- what lying robots do differently ---

    def carry_out(self, now_ms: int, n: int) -> list[Action]:
        """The controller acts on the INPUT in `work.entry[:n]`, and its outputs go out."""
        told = (self.put_out(now_ms, output) for output in self.decide(n))
        return [action for actions in told for action in self.checked("put_out", actions)]

    def checked(self, method: str, told: object) -> list[Action]:
        """What a method returned, if that is actions: a liar's may be a researcher's own.

        Raises: OwnMistake: it is not.
        """
        if type(self) is CNode:
            return told  # type: ignore[return-value] # its methods are these here
        if isinstance(told, list) and all(isinstance(each, Action) for each in told):
            return told
        wrong = next(each for each in told if not isinstance(each, Action)) if isinstance(told, list) else told
        raise OwnMistake(f"{method} returned {kind_of(wrong)}", "a list of actions, empty for nothing", self)

    def decide(self, entry_len: int) -> list[Send | Act]:
        """The controller's outputs for the INPUT in `work.entry`."""
        if self.controller:
            reading = self.w.entry[ENTRY_HEAD_BYTES:entry_len].tobytes()
            step, t_ms = int(self._step_of[self.i]), self._entry_time()
            evidence = b""
            if isinstance(self.controller, EvidenceController):
                evidence = self.evidence(step, t_ms, reading)
                self.keep_evidence(evidence)
            outputs = _ask(self.controller, step, t_ms, reading, evidence)
            self._step_of[self.i] += 1
            self._is_kept = False
            if not self.controller.is_ours:  # what it does wrong is told at once
                self.keep_state()
            return checked_outputs(outputs, self._frame_max, self.controller)
        n = node.think(self.f, self.i, self.w, entry_len)
        return unpack_outputs(self.w.out[:n].tobytes())

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
        """The evidence is in the log, right behind its INPUT."""
        if evidence and self.profile != PLAIN:
            marked = table.EVIDENCE.encode(bytes=evidence)
            log.append(self.f, self.i, row(marked), len(marked))

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        """One output through the a-node."""
        if isinstance(output, Send):
            return self.send(now_ms, output.payload, EVERYBODY)
        return self.act(now_ms, output.payload)

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        """A command through the a-node, logged."""
        if node.take(self.f, self.i, self.w, ACMD, now_ms, row(command), len(command)) < 0:
            return []
        return [Actuate(command)]

    def send(self, now_ms: int, frame: bytes, to: int) -> list[Action]:
        """A frame through the a-node, logged unless it is audit traffic."""
        n = node.take(self.f, self.i, self.w, SEND, now_ms, row(frame), len(frame))
        if n == trusted.E_AIRTIME and self.is_own and not frame[0] & request.AUDIT:
            # Else it would be stopped for an output that its log lacks, and nobody would know why.
            raise OwnMistake(
                f"robot {self.id}: its a-node has no airtime left for a frame of {len(frame)} bytes",
                "shorter frames, or fewer: in each state period as much airtime as four of 27 bytes",
                self.controller,
            )
        return [Transmit(self.w.entry[ENTRY_HEAD_BYTES:n].tobytes(), to)] if n > 0 else []

    def judged(self, now_ms: int) -> list[Action]:
        """An audit of ours is over, as `work.told` has it."""
        verdict = Verdict(int(self.w.told[node.TOLD_TEE]), Refusal(int(self.w.told[node.TOLD_REFUSAL])))
        return [verdict] if verdict.refusal else [verdict, *self.reply(now_ms, verdict.auditee)]

    def reply(self, now_ms: int, auditee: int) -> list[Action]:
        """The token in `work.frame` to the auditee."""
        return self._tell(now_ms, auditee)

    def _tell(self, now_ms: int, to: int) -> list[Action]:
        n = int(self.w.told[node.TOLD_LENGTH])
        return self.send(now_ms, self.w.frame[:n].tobytes(), to)

    def next_frame(self, now_ms: int) -> list[Action]:
        """The next fragment of an audit request, if one is due."""
        n = int(request.next_fragment(self.f, self.i, now_ms, self.w.frame))
        if n == 0 and self.make_request(now_ms):
            n = int(request.next_fragment(self.f, self.i, now_ms, self.w.frame))
        if n > 0:
            return self.send(now_ms, self.w.frame[:n].tobytes(), int(self.f.robot[self.i].request_to))
        at_ms = int(rounds.next_retry(self.f, self.i, now_ms))
        return [Retry(at_ms)] if at_ms >= 0 else []

    def make_request(self, now_ms: int) -> bool:
        """Whether a request for an audit is ready in `fleet.request`."""
        self.bring_up()  # its checkpoint is made now
        return bool(request.make_request(self.f, self.i, now_ms, *self.w.small[:3]) > 0)

    # --- plain-Python controllers ---

    def _entry_time(self) -> int:
        return int(get_u32(self.w.entry, ENTRY_T))

    def keep_state(self) -> None:
        """What a plain-Python controller remembers is where checkpoints are made from."""
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
        """As `node.judge`, with the mission's plain-Python controller."""
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
        while (event := audit.next_event(self.f, w, q)) > audit.END:
            at, length, t_ms, step, evidence_len = _EVENT(w.case.item())
            payload = q[at : at + length].tobytes()
            refused = 0
            if event == audit.RECV:
                controller.on_recv(t_ms, payload)
            elif event == log.ADVICE:
                controller.on_advice(payload)
            elif event == audit.INPUT:
                evidence = w.evidence[:evidence_len].tobytes()
                try:
                    outputs = list(_ask(controller, step, t_ms, payload, evidence))
                except PeerError:
                    return int(Refusal.EVIDENCE_WRONG)
                packed = pack_outputs(outputs)
                w.out[: len(packed)] = np.frombuffer(packed, np.uint8)
                refused = audit.expect(self.f, w, len(packed))
            else:
                state = controller.encode()
                w.state[CHECKPOINT_BYTES : CHECKPOINT_BYTES + len(state)] = np.frombuffer(state, np.uint8)
                refused = audit.check_state(w, q, len(state))
            if refused:
                return int(refused)
        if event == audit.END and controller.is_ours and not self.f.settings[0].plain:
            state = controller.encode()
            w.state[CHECKPOINT_BYTES : CHECKPOINT_BYTES + len(state)] = np.frombuffer(state, np.uint8)
            case.state_len = len(state)
            memo.remember(self.f.memo, w, q, known)
        return int(-event)


def _ask(controller: Controller, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Send | Act]:
    if isinstance(controller, EvidenceController):
        return controller.on_evidence(step, t_ms, reading, evidence)
    return controller.on_input(step, t_ms, reading)
