"""A robot that asks for audits, driven call by call: no simulation, and its auditors sign what a test wants."""

from __future__ import annotations

import numpy as np

from phalanx.bti import request, rounds, trusted
from phalanx.bti.fleet import HARDENED, make_fleet
from phalanx.bti.nodes import limits_of
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig, RadioConfig
from phalanx.config.flock import FlockConfig
from phalanx.robot import handlers
from phalanx.robot.adversary.liar import MOTION
from phalanx.robot.controllers.dispatch import NUMBERS
from phalanx.robot.controllers.flock_law import flock_params
from phalanx.wire.table import KIND_STATE
from phalanx.world.audited.setup import power_up

BOOT_MS = 1000
ROUND_MS = 4000
GRANT_MS = 600  # an a-node makes a token request each 571 ms
VICTIM = 0


class Asking:
    """A robot that asks for audits, and auditors that sign whatever they want to sign."""

    def __init__(self, profile=HARDENED, config=None, controller="flock", params=None):
        self.profile, self.config, n = profile, config or BtiConfig(), 8
        limits = limits_of(self.config, RadioConfig())
        nodes = power_up(n, profile, limits, np.full(n, BOOT_MS), np.random.default_rng(1), {})
        self.fleet = make_fleet(
            n,
            self.config,
            flock_params(FlockConfig(n_max=self.config.n_max)) if params is None else params,
            profile=profile,
            controller=NUMBERS[controller],
            mission_seed=5,
            snode=nodes.snode,
            anode=nodes.anode,
        )
        self.work, self.robot = make_work(self.config), self.fleet.robot[VICTIM]
        for i in range(n):
            handlers.on_boot(self.fleet, i, BOOT_MS)

    def round_begins(self, now_ms: int) -> None:
        for rob_id in range(2, 9):
            rounds.mark_in_range(self.fleet, VICTIM, rob_id, now_ms)
        rounds.begin_round(self.fleet, VICTIM, now_ms)

    def hears(self, now_ms: int) -> None:
        """So that its next checkpoint differs from its last."""
        state = bytearray(MOTION.pack(KIND_STATE, 3, now_ms, 0.0, 0.0, 0.0, 0.0))
        packet = np.frombuffer(state, np.uint8)
        assert handlers.on_packet(self.fleet, VICTIM, self.work, now_ms, packet, len(packet)) == handlers.HEARD

    def ask(self, now_ms: int) -> tuple[int, bytes]:
        """The auditor's id, and the request."""
        assert handlers.next_fragment(self.fleet, VICTIM, self.work, now_ms) > 0
        q = self.fleet.request.rows[self.robot.request_row, : int(self.robot.request_len)].tobytes()
        rounds.withdraw(self.fleet, VICTIM)
        return int(self.robot.request_to), q

    def token(self, auditor: int, q: bytes, which: int) -> tuple[int, int, np.ndarray]:
        """The auditor's, for one of the victim's checkpoints."""
        head, mac = np.frombuffer(bytearray(q), np.uint8), np.zeros(8, np.uint8)
        t = int.from_bytes(q[request.AT_T : request.AT_TOP_A], "little")
        top, treq = head[request.AT_TOP_A :][:20].copy(), head[request.AT_TREQ_MAC :][:8].copy()
        hckpt, anode = self.fleet.hckpt[VICTIM, which], self.fleet.anode[auditor - 1]
        assert trusted.anode_issue_token(self.profile, anode, VICTIM + 1, t, top, treq, hckpt, mac) >= 0
        return auditor, t, mac

    def gets(self, token: tuple[int, int, np.ndarray], now_ms: int) -> int:
        """The token is installed; how many robots have answered in this round by now."""
        assert rounds.on_token(self.fleet, VICTIM, *token, now_ms) == 0
        return int(self.robot.got)
