"""One robot outside the simulator, with the timers that the simulator's loop keeps otherwise.

A pure state machine: the caller has the clock, the sensors, the radio and the actuators. The caller reads which event
is due next, calls its method, and carries out the actions returned. The same readings, packets and times give the same
log as in the simulator, byte for byte. Source: docs/spec/rebound.md (c-node).
"""

from __future__ import annotations

import heapq

from phalanx.bti import rounds, trusted
from phalanx.config import BtiConfig

from .actions import Action, Actuate, RetryAt, RoundAt, Transmit, Verdict
from .adversary.liar import Liar
from .robot import Robot

# Soon after the mission key, and at another moment for each robot.
FIRST_ROUND_MS = 200
NEVER_MS = 1 << 62
Done = Transmit | Actuate | Verdict


def first_round_ms(mission_seed: int, rob_id: int, t_audit_ms: int) -> int:
    """Return how long after the mission key a robot's first round begins; each later one begins T_audit after the last.

    A robot not yet heard in the first round can be asked in the second, before T_val is over.
    """
    return FIRST_ROUND_MS + int(rounds.mix_hash(mission_seed + 1, rob_id)) % t_audit_ms


class Runtime:
    """A robot whose mission key was loaded at `now_ms` of its trusted nodes' clock, and the times of its next events.

    Attributes:
        check_ms: when its a-node checks its tokens next.
        wake_ms: when an attack acts out of turn next.
        in_safe_mode: whether the a-node has stopped it; then no event is due.
    """

    def __init__(self, robot: Robot, config: BtiConfig, now_ms: int) -> None:
        self.robot, self._config = robot, config
        self.in_safe_mode = False
        robot.on_boot(now_ms)
        seed = int(robot.f.settings[0].mission_seed)
        # Heap of rounds: when, and whether the robot has listened.
        self._rounds = [(now_ms + first_round_ms(seed, robot.id, config.t_audit_ms), False)]
        self._retry_ms = NEVER_MS
        self.check_ms = now_ms + config.p_check_ms
        self.wake_ms = NEVER_MS
        if isinstance(robot, Liar) and robot.period_ms:
            self.wake_ms = max(now_ms + robot.period_ms, robot.plan.start_ms)
        self._step = 0

    @property
    def input_ms(self) -> int:
        """Return when its sensors must be read next: on the grid that its auditors know."""
        return int(rounds.grid(self.robot.f, self.robot.i, self._step))

    @property
    def audit_ms(self) -> int:
        """Return when the next round or retry is due."""
        return min(self._rounds[0][0], self._retry_ms)

    @property
    def due_ms(self) -> int:
        """Return when the earliest of the four is due."""
        return min(self.input_ms, self.audit_ms, self.check_ms, self.wake_ms)

    def on_reading(self, now_ms: int, reading: bytes, advice: bytes = b"") -> list[Done]:
        """Handle a planner's advice, if there is some, and then a reading."""
        self._step += 1
        if advice:
            self.robot.on_advice(advice)
        return self._kept(now_ms, self.robot.on_reading(now_ms, reading))

    def on_audit(self, now_ms: int) -> list[Done]:
        """Handle the round or the retry that was due at `audit_ms`."""
        if self._retry_ms < self._rounds[0][0]:
            self._retry_ms = NEVER_MS
            return self._kept(now_ms, self.robot.on_retry(now_ms))
        due_ms, listened = heapq.heappop(self._rounds)
        return self._kept(now_ms, self.robot.on_round(now_ms, listened=listened), now_ms - due_ms)

    def on_wake(self, now_ms: int) -> list[Done]:
        """Let an attack act out of turn."""
        assert isinstance(self.robot, Liar)
        done = self._kept(now_ms, self.robot.on_wake(now_ms) if self.robot.lies(now_ms) else [])
        self.wake_ms = now_ms + self.robot.period_ms
        return done

    def on_check(self, now_ms: int) -> bool:
        """Have the a-node check its tokens; return whether it has stopped the robot."""
        self.check_ms += self._config.p_check_ms
        fleet, i = self.robot.f, self.robot.i
        self.in_safe_mode = bool(trusted.anode_check(int(fleet.settings[0].profile), fleet.anode[i], now_ms))
        return self.in_safe_mode

    def on_packet(self, now_ms: int, packet: bytes) -> list[Done]:
        """Handle a packet of any bytes."""
        return self._kept(now_ms, self.robot.on_packet(now_ms, packet)) if packet else []

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Done]:
        """Send the next fragment of an audit request: the radio has sent the last one, or given it up."""
        return self._kept(now_ms, self.robot.on_sent(now_ms, arrived=arrived))

    def _kept(self, now_ms: int, actions: list[Action], late_ms: int = 0) -> list[Done]:
        """Set the timers that actions ask for, and return the other actions."""
        done: list[Done] = []
        for action in actions:
            if isinstance(action, RoundAt):
                # Rounds keep their pace, however late one of them is.
                at_ms = action.at_ms if action.listened else action.at_ms - late_ms
                heapq.heappush(self._rounds, (at_ms, action.listened))
            elif isinstance(action, RetryAt):
                self._retry_ms = min(self._retry_ms, max(action.at_ms, now_ms))
            else:
                done.append(action)
        return done
