"""A robot outside of any world, and the timers that a world would keep for it.

A pure state machine: the caller has the clock, the sensors, the radio and the actuators. It asks what is due, calls
that, and carries out the actions that come back. The same readings, packets and moments give the same log as in the
simulator, byte for byte. Source: docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

import heapq

from phalanx.bti import rounds, trusted
from phalanx.config import BtiConfig

from .actions import Action, Actuate, RetryAt, RoundAt, Transmit, Verdict, is_earlier
from .attacks.liar import Liar
from .robot import Robot

# Soon after the mission key, and at another moment for each robot.
FIRST_ROUND_MS = 200
NEVER_MS = 1 << 62
Done = Transmit | Actuate | Verdict


def first_round_ms(mission_seed: int, rob_id: int, t_audit_ms: int) -> int:
    """Return how long after the mission key a robot's first round begins; every later one T_audit after the last.

    Who is not heard yet when the first round comes is asked in the second, before T_val is over.
    """
    return FIRST_ROUND_MS + int(rounds.mixed(mission_seed + 1, rob_id)) % t_audit_ms


class Runtime:
    """A robot whose mission key was loaded at `now_ms` of its trusted nodes' clock, and what is due of it.

    Attributes:
        input_ms: when its sensors are to be read next.
        audit_ms: when something of its audits is due next.
        check_ms: when its a-node is to look at its tokens next.
        wake_ms: when an attacker's own turn is next.
        in_safe_mode: whether the a-node has stopped it; nothing is due any more.
    """

    def __init__(self, robot: Robot, config: BtiConfig, now_ms: int) -> None:
        self.robot, self._config = robot, config
        self.in_safe_mode = False
        robot.on_boot(now_ms)
        seed = int(robot.f.settings[0].mission_seed)
        # When a round or a retry is due, whether it is a retry, and whether the robot has listened. Each comes.
        self._audits = [(now_ms + first_round_ms(seed, robot.id, config.t_audit_ms), False, False)]
        self._retry_ms = -1
        self.check_ms = now_ms + config.p_check_ms
        self.wake_ms = NEVER_MS
        if isinstance(robot, Liar) and robot.period_ms:
            self.wake_ms = max(now_ms + robot.period_ms, robot.plan.start_ms)
        self._step = 0

    @property
    def input_ms(self) -> int:
        """On the grid that its auditors know."""
        return int(rounds.grid(self.robot.f, self.robot.i, self._step))

    @property
    def audit_ms(self) -> int:
        """The next round, or when further robots are asked."""
        return self._audits[0][0]

    @property
    def due_ms(self) -> int:
        """The first of all four."""
        return min(self.input_ms, self.audit_ms, self.check_ms, self.wake_ms)

    def on_reading(self, now_ms: int, reading: bytes, advice: bytes = b"") -> list[Done]:
        """The sensors were read; before that, a planner may have advised."""
        self._step += 1
        if advice:
            self.robot.on_advice(advice)
        return self._kept(now_ms, self.robot.on_reading(now_ms, reading))

    def on_audit(self, now_ms: int) -> list[Done]:
        """Do what is due of the audits at `audit_ms`."""
        due_ms, is_retry, listened = heapq.heappop(self._audits)
        if is_retry:
            self._retry_ms = -1
            return self._kept(now_ms, self.robot.on_retry(now_ms))
        return self._kept(now_ms, self.robot.on_round(now_ms, listened=listened), now_ms - due_ms)

    def on_wake(self, now_ms: int) -> list[Done]:
        """It is an attacker's own turn."""
        assert isinstance(self.robot, Liar)
        done = self._kept(now_ms, self.robot.on_wake(now_ms) if self.robot.lies(now_ms) else [])
        self.wake_ms = now_ms + self.robot.period_ms
        return done

    def on_check(self, now_ms: int) -> bool:
        """Have the a-node look at its tokens; return whether it has stopped the robot."""
        self.check_ms += self._config.p_check_ms
        fleet, i = self.robot.f, self.robot.i
        self.in_safe_mode = bool(trusted.anode_check(int(fleet.settings[0].profile), fleet.anode[i], now_ms))
        return self.in_safe_mode

    def on_packet(self, now_ms: int, packet: bytes) -> list[Done]:
        """A packet has arrived, of any bytes."""
        return self._kept(now_ms, self.robot.on_packet(now_ms, packet)) if packet else []

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Done]:
        """The radio is done with the last fragment of an audit request."""
        return self._kept(now_ms, self.robot.on_sent(now_ms, arrived=arrived))

    def _kept(self, now_ms: int, actions: list[Action], late_ms: int = 0) -> list[Done]:
        """Keep the timers that were asked for, and return the other actions."""
        done: list[Done] = []
        for action in actions:
            if isinstance(action, RoundAt):
                # Rounds keep their pace, however late one of them is.
                at_ms = action.at_ms if action.listened else action.at_ms - late_ms
                heapq.heappush(self._audits, (at_ms, False, action.listened))
            elif isinstance(action, RetryAt):
                at_ms = max(action.at_ms, now_ms)
                if is_earlier(at_ms, self._retry_ms):
                    self._retry_ms = at_ms
                    heapq.heappush(self._audits, (at_ms, True, False))
            else:
                done.append(action)
        return done
