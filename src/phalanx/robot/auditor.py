"""Deterministic replay of an auditee's log with the controller that the mission prescribes.

Source: RoboRebound §3.7; docs/spec/rebound.md (Auditor).
"""

from __future__ import annotations

from phalanx.bti import audit
from phalanx.bti.audit import Work
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.request import AT_FLAGS
from phalanx.bti.rounds import CHECKPOINT_BYTES
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
    if q[AT_FLAGS]:
        state_len = dispatch.begin(s.controller, f.params, c.tee, state)
    else:
        state_len = c.start_len - CHECKPOINT_BYTES
        if not dispatch.is_encoding(s.controller, f.params, c.tee, state, state_len):
            return Refusal.STATE_MALFORMED
    while True:
        event = audit.next_event(f, w, q)
        if event <= audit.END:
            return int(-event)
        payload = q[c.payload_at : c.payload_at + c.payload_len]
        if event == audit.RECV:
            state_len = dispatch.on_recv(s.controller, f.params, c.tee, c.entry_t, payload, c.payload_len, state)
        elif event == audit.INPUT:
            n = dispatch.on_input(
                s.controller, f.params, c.tee, c.step, c.entry_t, payload, c.payload_len, state, w.out
            )
            refused = audit.expect(f, w, n)
            if refused:
                return int(refused)
            state_len = dispatch.size(s.controller, state)
        else:
            refused = audit.check_state(w, q, state_len)
            if refused:
                return int(refused)
