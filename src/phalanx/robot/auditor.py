"""Deterministic replay of an auditee's log with the controller that the mission prescribes.

Source: RoboRebound §3.7; docs/spec/rebound.md (Auditor).
"""

from __future__ import annotations

from phalanx.bti import audit, trusted
from phalanx.bti.audit import Work
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.request import AT_FLAGS, AT_HCKPT, AT_T, AT_TOP_A, AT_TREQ_MAC
from phalanx.bti.rounds import CHECKPOINT_BYTES
from phalanx.kernel import kernel
from phalanx.wire.fields import Row, get_u32
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from .controllers import dispatch


@kernel
def open_request(w: Work, q: Row, length: int, src: int) -> int:
    """The request has a form, and names its sender as the auditee. Returns: 0 or a `Refusal`."""
    refused = audit.open_request(w, q, length)
    if refused == 0 and w.case[0].tee != src:
        refused = Refusal.NOT_THE_SENDER
    return int(refused)


@kernel
def examine(f: Fleet, i: int, w: Work, q: Row, length: int, src: int) -> int:
    """All checks that come before the replay. Returns: 0 or a `Refusal`. Source: RoboRebound §3.7."""
    refused = open_request(w, q, length, src)
    if refused == 0:
        refused = audit.check_start(f, i, w, q)
    if refused == 0:
        refused = audit.check_authenticators(f, i, w, q)
    if refused == 0:
        refused = audit.check_chains(f, w, q)
    return int(refused)


@kernel
def replay(f: Fleet, w: Work, q: Row) -> int:
    """The log's outputs are those of the bundled controller, from its start to its end, and the state agrees.

    Returns: 0 or a `Refusal`. Source: RoboRebound §3.7.
    """
    c, s = w.case[0], f.settings[0]
    state = w.state[CHECKPOINT_BYTES:]
    if q[AT_FLAGS] == 1:
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


@kernel
def issue(f: Fleet, i: int, w: Work, q: Row, mac: Row) -> int:
    """The auditor's a-node signs that the auditee's log is right up to this request; `mac` (8,) gets the token's.

    Returns: 0 or `Refusal.REQUEST_INVALID`. Source: RoboRebound Alg. 4.
    """
    tee, t = w.case[0].tee, get_u32(q, AT_T)
    top, hckpt = q[AT_TOP_A : AT_TOP_A + HASH_BYTES], q[AT_HCKPT : AT_HCKPT + HASH_BYTES]
    treq = q[AT_TREQ_MAC : AT_TREQ_MAC + MAC_BYTES]
    code = trusted.anode_issue_token(f.settings[0].profile, f.anode[i], tee, t, top, treq, hckpt, mac)
    return 0 if code >= 0 else Refusal.REQUEST_INVALID
