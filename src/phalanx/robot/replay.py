"""Deterministic replay of a log with the mission's controller.

It is compiled for bundled controllers, and in Python for others and for whole logs (retrace.py).
Source: RoboRebound §3.7; docs/spec/rebound.md (Auditor).
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import itemgetter
from typing import Final

import numpy as np

from phalanx.bti import audit, log, memo
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.request import AT_FLAGS
from phalanx.bti.rounds import CHECKPOINT_BYTES
from phalanx.bti.work import CASE, Work
from phalanx.errors import PeerError
from phalanx.kernel import kernel
from phalanx.wire.fields import Row

from .controllers import dispatch
from .controllers.python_controller import Act, Controller, EvidenceController, Send, pack_outputs

# Fields of each event, read as one tuple in 0.2 us; a single field of a numpy record would take 2 us.
_EVENT: Final = itemgetter(
    *map(list(CASE.fields or ()).index, ("payload_at", "payload_len", "entry_t", "step", "evidence_len"))
)


def replay(f: Fleet, w: Work, q: Row, controller: Controller, *, is_claim: bool = True) -> int:
    """Replay the log of `work.case` in `q`, and compare its outputs with the controller's.

    `is_claim`: the log is in a request, which claims the hash of the state at the checkpoint.
    Returns: 0 or a `Refusal`.
    """
    while (event := int(audit.next_event(f, w, q))) > audit.END:
        at, length, t_ms, step, evidence_len = _EVENT(w.case.item())
        payload = q[at : at + length].tobytes()
        refused = 0
        if event == audit.RECV:
            controller.on_recv(t_ms, payload)
        elif event == log.ADVICE:
            controller.on_advice(payload)
        elif event == audit.INPUT:
            try:
                packed = pack_outputs(decide(controller, step, t_ms, payload, w.evidence[:evidence_len].tobytes()))
            except PeerError:
                return Refusal.EVIDENCE_WRONG
            w.out[: len(packed)] = np.frombuffer(packed, np.uint8)
            refused = audit.expect(f, w, len(packed))
        elif is_claim:
            refused = audit.check_state(w, q, show_state(w, controller))
        if refused:
            return int(refused)
    return -event


def show_state(w: Work, controller: Controller) -> int:
    """Write the controller's encoded state to `work.state`, after the checkpoint's fixed fields; return its length."""
    state = controller.encode()
    w.state[CHECKPOINT_BYTES : CHECKPOINT_BYTES + len(state)] = np.frombuffer(state, np.uint8)
    return len(state)


def decide(controller: Controller, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Send | Act]:
    """Return a controller's outputs for a reading, with the evidence that follows it in the log."""
    if isinstance(controller, EvidenceController):
        return controller.on_evidence(step, t_ms, reading, evidence)
    return controller.on_input(step, t_ms, reading)


# --- with a bundled controller, compiled ---


@kernel
def replay_bundled(f: Fleet, w: Work, q: Row) -> int:
    """Replay the log of `work.case` in `q` with the bundled controller; see `replay`.

    Returns: 0 or a `Refusal`. Source: RoboRebound §3.7.
    """
    c, s = w.case[0], f.settings[0]
    state = w.state[CHECKPOINT_BYTES:]
    state_len = _begin(f, w, q, state)
    if state_len < 0:
        return Refusal.STATE_MALFORMED
    while True:
        event = audit.next_event(f, w, q)
        if event <= audit.END:
            c.state_len = state_len
            if event == audit.END and s.plain == 0:
                memo.remember(f.memo, w, q, c.known)
            return int(-event)
        payload = q[c.payload_at : c.payload_at + c.payload_len]
        if event == audit.RECV:
            state_len = dispatch.on_recv(s.controller, f.params, c.auditee, c.entry_t, payload, c.payload_len, state)
        elif event == log.ADVICE:
            dispatch.on_advice(s.controller, f.params, c.auditee, payload, c.payload_len, state)
            state_len = dispatch.size(s.controller, state)
        elif event == audit.INPUT:
            n = dispatch.on_input(
                s.controller, f.params, c.auditee, c.step, c.entry_t, payload, c.payload_len, state, w.out
            )
            state_len = dispatch.size(s.controller, state)
            refused = audit.expect(f, w, n)
            if refused:
                return int(refused)
        else:
            refused = audit.check_state(w, q, state_len)
            if refused:
                return int(refused)


@kernel
def _begin(f: Fleet, w: Work, q: Row, state: Row) -> int:
    """Write the state from which the log begins to `state`; return its length, -1 if it is malformed."""
    c, s = w.case[0], f.settings[0]
    if c.known:
        return int(c.state_len)
    if q[AT_FLAGS]:
        return int(dispatch.begin(s.controller, f.params, c.auditee, state))
    length = c.start_len - CHECKPOINT_BYTES
    return int(length) if dispatch.is_encoding(s.controller, f.params, c.auditee, state, length) else -1
