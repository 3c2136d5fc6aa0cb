"""Deterministic replay of an auditee's log with the controller that the mission prescribes.

Source: RoboRebound §3.7; docs/spec/rebound.md (Auditor).
"""

from __future__ import annotations

from phalanx.bti import audit, log, memo
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.request import AT_FLAGS
from phalanx.bti.rounds import CHECKPOINT_BYTES
from phalanx.bti.work import Work
from phalanx.kernel import kernel
from phalanx.wire.fields import Row

from .controllers import dispatch


@kernel
def replay(f: Fleet, w: Work, q: Row) -> int:
    """The log's outputs are those of the bundled controller, from its start to its end, and the state agrees.

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
            state_len = dispatch.on_recv(s.controller, f.params, c.tee, c.entry_t, payload, c.payload_len, state)
        elif event == log.ADVICE:
            dispatch.on_advice(s.controller, f.params, c.tee, payload, c.payload_len, state)
            state_len = dispatch.size(s.controller, state)
        elif event == audit.INPUT:
            n = dispatch.on_input(
                s.controller, f.params, c.tee, c.step, c.entry_t, payload, c.payload_len, state, w.out
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
    """The length of the state from which the log is replayed, in `state`; -1 if that is none."""
    c, s = w.case[0], f.settings[0]
    if c.known:
        return int(c.state_len)
    if q[AT_FLAGS]:
        return int(dispatch.begin(s.controller, f.params, c.tee, state))
    length = c.start_len - CHECKPOINT_BYTES
    return int(length) if dispatch.is_encoding(s.controller, f.params, c.tee, state, length) else -1
