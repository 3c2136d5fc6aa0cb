"""A robot outside of any world: its c-node, and the timers that a world would keep for it.

A pure state machine: whoever has the clock, the sensors, the radio and the actuators asks what is due, calls it, and
does what comes back. The same readings, frames and moments give the same log as in the simulator, byte for byte.
Source: docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

import heapq

from phalanx.bti import request, rounds, trusted
from phalanx.config import BtiConfig

from .attacks.liar import Liar
from .cnode import Action, Actuate, CNode, Retry, Transmit, Verdict

# Soon after the mission key, and at another moment for each robot.
FIRST_ROUND_MS = 200
NEVER_MS = 1 << 62
Done = Transmit | Actuate | Verdict


def first_round_ms(mission_seed: int, rob_id: int, t_audit_ms: int) -> int:
    """How long after the mission key a robot's first round of audits begins; every later one T_audit after the last.

    Who is not heard yet when the first round comes is asked in the second, before T_val is over.
    """
    return FIRST_ROUND_MS + int(rounds.mixed(mission_seed + 1, rob_id)) % t_audit_ms


class Runtime:
    """A c-node whose mission key was loaded at `now_ms` of its trusted nodes' clock, and what is due of it.

    Attributes:
        input_ms: when its sensors are to be read next.
        audit_ms: when something of its audits is due next.
        check_ms: when its a-node is to look at its tokens next.
        wake_ms: when a liar is to have its turn next.
        in_safe_mode: whether that has stopped it; nothing is due any more.
    """

    def __init__(self, cnode: CNode, config: BtiConfig, now_ms: int) -> None:
        self.cnode, self._config = cnode, config
        self.in_safe_mode = False
        cnode.on_boot(now_ms)
        seed = int(cnode.f.settings[0].mission_seed)
        self._round_ms = now_ms + first_round_ms(seed, cnode.id, config.t_audit_ms)
        self._listened_ms = NEVER_MS  # when a round that is due begins, of a robot that listens first
        self._retries: list[int] = []  # each comes, though an earlier one was asked for later
        self._retry_ms = -1
        self.check_ms = now_ms + config.p_check_ms
        self.wake_ms = NEVER_MS
        if isinstance(cnode, Liar) and cnode.period_ms:
            self.wake_ms = max(now_ms + cnode.period_ms, cnode.plan.start_ms)
        self._step = 0

    @property
    def input_ms(self) -> int:
        """On the grid that its auditors know."""
        return int(rounds.grid(self.cnode.f, self.cnode.i, self._step))

    @property
    def audit_ms(self) -> int:
        """The next round, or when further robots are asked."""
        return min(self._round_ms, self._listened_ms, *self._retries[:1])

    @property
    def due_ms(self) -> int:
        """The first of all four."""
        return min(self.input_ms, self.audit_ms, self.check_ms, self.wake_ms)

    def on_input(self, now_ms: int, reading: bytes, advice: bytes = b"") -> list[Done]:
        """The sensors were read; before that, a planner may have said something."""
        self._step += 1
        if advice:
            self.cnode.on_advice(advice)
        return self._kept(now_ms, self.cnode.on_sensor(now_ms, reading))

    def on_audit(self, now_ms: int) -> list[Done]:
        """What is due of the audits at `audit_ms` was done."""
        due_ms = self.audit_ms
        if due_ms == self._round_ms:
            self._round_ms += self._config.t_audit_ms
            listens_ms = int(request.listens(self.cnode.f, self.cnode.i, now_ms, self.cnode.w.small[1]))
            if listens_ms > 0:
                self._listened_ms = now_ms + listens_ms
                return []
        elif due_ms == self._listened_ms:
            self._listened_ms = NEVER_MS
        else:
            heapq.heappop(self._retries)
            self._retry_ms = -1
            return self._kept(now_ms, self.cnode.on_retry(now_ms))
        return self._kept(now_ms, self.cnode.on_round(now_ms))

    def on_wake(self, now_ms: int) -> list[Done]:
        """A liar has had its turn."""
        assert isinstance(self.cnode, Liar)
        done = self._kept(now_ms, self.cnode.on_wake(now_ms) if self.cnode.lies(now_ms) else [])
        self.wake_ms = now_ms + self.cnode.period_ms
        return done

    def on_check(self, now_ms: int) -> bool:
        """The a-node has looked at its tokens; whether it has stopped the robot."""
        self.check_ms += self._config.p_check_ms
        fleet, i = self.cnode.f, self.cnode.i
        self.in_safe_mode = bool(trusted.anode_check(int(fleet.settings[0].profile), fleet.anode[i], now_ms))
        return self.in_safe_mode

    def on_frame(self, now_ms: int, frame: bytes) -> list[Done]:
        """A frame has arrived, of any bytes."""
        return self._kept(now_ms, self.cnode.on_message(now_ms, frame)) if frame else []

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Done]:
        """The radio is done with the last fragment of an audit request."""
        return self._kept(now_ms, self.cnode.on_sent(now_ms, arrived=arrived))

    def _kept(self, now_ms: int, actions: list[Action]) -> list[Done]:
        done: list[Done] = []
        for action in actions:
            if isinstance(action, Retry):
                at_ms = max(action.at_ms, now_ms)
                if self._retry_ms < 0 or at_ms < self._retry_ms:
                    self._retry_ms = at_ms
                    heapq.heappush(self._retries, at_ms)
            else:
                done.append(action)
        return done


def is_fragment(frame: bytes) -> bool:
    """Whether the c-node waits to be told that this frame is sent."""
    return bool(frame[0] & request.AUDIT) and frame[request.AT_SUB] == request.FRAGMENT
