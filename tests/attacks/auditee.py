"""A robot with true nodes whose c-node chains and logs what a test says, and the auditors that judge it."""

from __future__ import annotations

import numpy as np
from asking import BOOT_MS, VICTIM, Asking
from caught import Judge

from phalanx.bti import log, request, rounds, trusted
from phalanx.bti.audit import ACMD, INPUT, RECV, SEND
from phalanx.bti.fleet import HARDENED, PENDING
from phalanx.robot import handlers
from phalanx.robot.adversary.liar import MOTION
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.python_controller import Act, unpack_outputs
from phalanx.wire.fields import row
from phalanx.wire.table import KIND_SENSOR, KIND_STATE

DELTA_MS, SKEW_MS = 100, 50
# From the first INPUT on, before which a-nodes make no request.
STEPS = 4
ASKED_MS = 60  # after an INPUT


class Auditee(Asking):
    """A robot with true nodes, whose c-node chains and logs what a test says."""

    def __init__(self, **said):
        super().__init__(**said)
        self.judge = Judge(self.fleet, self.config)
        self.round_begins(BOOT_MS)
        self.step = 0

    def due_ms(self, step: int | None = None) -> int:
        """When an INPUT is due, the next one if nothing is said."""
        return int(rounds.grid(self.fleet, VICTIM, self.step if step is None else step))

    def chained(self, kind: int, t_ms: int, payload: bytes) -> bytes:
        """The entry, from the trusted node."""
        n = handlers.chain(self.fleet, VICTIM, self.work, kind, t_ms, row(payload), len(payload))
        assert n > 0
        return self.work.entry[:n].tobytes()

    def logs(self, entry: bytes) -> None:
        assert log.append(self.fleet, VICTIM, row(entry), len(entry)) == 0

    def polled(self, t_ms: int) -> bytes:
        return self.chained(INPUT, t_ms, MOTION.pack(KIND_SENSOR, 1, t_ms, self.step, 2.0, 0.0, 0.0))

    def thinks(self, entry: bytes) -> list[tuple[int, bytes]]:
        """What the controller puts out on an INPUT: kind and payload of each."""
        self.work.entry[: len(entry)] = row(entry)
        n = handlers.run_controller(self.fleet, VICTIM, self.work, len(entry))
        self.step += 1
        told = unpack_outputs(self.work.out[:n].tobytes())
        return [(ACMD if isinstance(each, Act) else SEND, each.payload) for each in told]

    def senses(self, t_ms: int | None = None, late_ms: int = 0) -> None:
        """An INPUT when it is due, or then, and its outputs so much later."""
        t_ms = self.due_ms() if t_ms is None else t_ms
        entry = self.polled(t_ms)
        self.logs(entry)
        for kind, payload in self.thinks(entry):
            self.logs(self.chained(kind, t_ms + late_ms, payload))

    def hears_of(self, t_ms: int) -> bytes:
        """A state of robot 3's; the controller knows it, the log not yet."""
        packet = MOTION.pack(KIND_STATE, 3, t_ms, 5.0, 5.0, 0.0, 0.0)
        entry = self.chained(RECV, t_ms, packet)
        f, s = self.fleet, self.fleet.settings[0]
        dispatch.on_recv(s.controller, f.params, 1, t_ms, row(packet), len(packet), f.state[VICTIM])
        self.robot.state_len = dispatch.size(s.controller, f.state[VICTIM])
        return entry

    def goes_on(self) -> None:
        for _ in range(STEPS):
            self.senses()

    def asks(self, now_ms: int | None = None) -> tuple[int, bytes]:
        """The auditor's id and the request; a while after the last INPUT if nothing is said."""
        return self.ask(self.due_ms(self.step - 1) + ASKED_MS if now_ms is None else now_ms)

    def verdict(self, asked: tuple[int, bytes]) -> int:
        auditor, q = asked
        return self.judge(VICTIM, auditor - 1, q)[0]

    def covered(self) -> None:
        """Its log begins at a checkpoint with f_max + 1 tokens."""
        self.goes_on()
        for k in range(self.config.tokens_needed):
            now_ms = self.due_ms(self.step - 1) + ASKED_MS
            while True:  # the a-node's bucket
                if handlers.next_fragment(self.fleet, VICTIM, self.work, now_ms) > 0:
                    break
                self.robot.quota = 1
                self.senses()
                now_ms = self.due_ms(self.step - 1) + ASKED_MS
            q = self.fleet.request.rows[self.robot.request_row, : int(self.robot.request_len)].tobytes()
            rounds.withdraw(self.fleet, VICTIM)
            auditor = int(self.robot.request_to)
            assert self.verdict((auditor, q)) == 0
            assert self.gets(self.token(auditor, q, PENDING), now_ms) == k + 1
        assert not self.robot.booted
        assert self.robot.tokens_start == self.config.tokens_needed
        for _ in range(20):
            self.senses()
        self.round_begins(self.due_ms(self.step - 1))

    def between(self, now_ms: int) -> tuple[int, np.ndarray, np.ndarray]:
        """A token request, made; the s-node has still to sign: its auditor, and both records."""
        rounds.withdraw(self.fleet, VICTIM)
        auditor = int(rounds.next_candidate(self.fleet, VICTIM, now_ms))
        treq, auth = row(bytes(request.TREQ_BYTES)), row(bytes(30))
        assert trusted.anode_token_request(HARDENED, self.fleet.anode[VICTIM], now_ms, auditor, treq) >= 0
        log.mark(self.fleet, VICTIM, log.FLUSH_A)
        return auditor, treq, auth

    def signed(self, auditor: int, treq: np.ndarray, auth: np.ndarray) -> tuple[int, bytes]:
        """The rest of it."""
        assert trusted.snode_make_auth(HARDENED, self.fleet.snode[VICTIM], treq[request.TREQ_BYTES - 8 :], auth) >= 0
        log.mark(self.fleet, VICTIM, log.FLUSH_S)
        n = int(request._write(self.fleet, VICTIM, treq, auth, row(bytes(30))))
        return auditor, self.fleet.request.rows[self.robot.request_row, :n].tobytes()
