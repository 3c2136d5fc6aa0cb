"""Parameters of bounded-time interaction, and the sizes and rates that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.errors import UsageError

from .parameter import check_limits, within

REQUEST_OVERHEAD_BYTES = 300
CHECKPOINT_BYTES = 66
NEIGHBOUR_BYTES = 26
STATE_ENTRY_BYTES = 34
ENTRY_HEAD_BYTES = 7
ADVICE_HEAD_BYTES = 3
# Extra log bytes per state period and compromised neighbour: the longest packet that takes the airtime of four states,
# less the state that it replaces.
LIAR_BYTES = 376
# Of one request: index and count are one byte each, and a 64-bit mask marks the fragments that have arrived.
MOST_FRAGMENTS = 63
FRAGMENT_HEAD_BYTES = 10
MOST_CHECKPOINT_BYTES = 65_535


def tokens_of(f_max: int) -> int:
    """Return how many fresh tokens from different auditors keep a robot out of Safe Mode."""
    return f_max + 1


def quorum_of(f_max: int) -> int:
    """Return how many correct neighbours, in range in both directions, guarantee P2 for a robot.

    It is one more than the tokens that a robot needs: compromised robots may jam one auditor. Source: docs/promises.md.
    """
    return tokens_of(f_max) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class BtiConfig:
    """Parameters of the audits; the defaults are the paper's where it gives one.

    Raises: UsageError: a value is out of range. Source: RoboRebound §4, §5.2; docs/spec/rebound.md.
    """

    f_max: int = within(
        3, 1, 15, "compromised robots that a mission tolerates; f_max + 1 fresh tokens keep a robot out of Safe Mode"
    )
    t_audit_ms: int = within(4000, 500, 600_000, "period of audit rounds")
    t_val_ms: int = within(10_000, 1000, 3_600_000, "lifetime of a token")
    t_control_ms: int = within(250, 20, 10_000, "period of control steps and of sensor readings")
    steps_per_state: int = within(6, 1, 1000, "control periods from one state broadcast to the next (1.5 s)")
    p_check_ms: int = within(100, 1, 100, "period of the a-node's CheckTokens")
    delta_ms: int = within(
        100, 1, 1000, "largest delay of an output after its cause, and of a sensor reading from its due time"
    )
    skew_ms: int = within(50, 1, 1000, "how much older a log entry may be than the newest before it")
    retry_ms: int = within(50, 5, 10_000, "time without enough tokens after which further auditors are asked")
    batch_size: int = within(10, 1, 255, "entries that go into one link of a hash chain")
    n_max: int = within(24, 1, 400, "neighbours for which storage and airtime suffice; at least a quorum, f_max + 2")
    packet_max_bytes: int = within(2048, 256, 2048, "longest radio packet")
    reading_bytes: int = within(27, 1, 2048, "length of a sensor reading as it is chained")
    command_bytes: int = within(19, 1, 2048, "length of the command to the actuators in each control period")
    state_bytes: int = within(
        0,
        0,
        MOST_CHECKPOINT_BYTES - CHECKPOINT_BYTES,
        "largest state of the controller; 0: that of a flock with n_max neighbours",
    )
    advice_bytes: int = within(0, 0, 255, "length of a planner's advice in each control period; 0: no planner")
    evidence_max_bytes: int = within(0, 0, 65_535, "longest evidence for one reading in a log; 0: none")
    evidence_bytes_per_s: int = within(0, 0, 1_000_000, "mean rate of evidence for which a log has room")

    def __post_init__(self) -> None:
        check_limits(self)
        if self.n_max < self.quorum:
            raise UsageError(
                f"n_max is {self.n_max}, less than the quorum of {self.quorum} neighbours for f_max {self.f_max}",
                f"use an n_max of at least {self.quorum}, or a smaller f_max",
            )
        if self.t_val_ms < self.t_audit_ms * 3 // 2:
            raise UsageError(
                f"t_val is {self.t_val_ms / 1000:g} s, too short for audit rounds every {self.t_audit_ms / 1000:g} s",
                "use a t_val of at least 1.5 times t_audit, or correct robots run out of tokens",
            )
        fragments = -(-self.request_capacity_bytes // (self.packet_max_bytes - FRAGMENT_HEAD_BYTES))
        if fragments > MOST_FRAGMENTS:
            raise UsageError(
                f"an audit request of {self.request_capacity_bytes} bytes takes {fragments} packets",
                f"at most {MOST_FRAGMENTS}: use a shorter t_val, a smaller n_max or longer packets",
            )
        # Evidence is logged while the log is less than half full: the other half is for packets of other robots.
        if self.evidence_max_bytes and self.evidence_bytes_per_s < self._entries_bytes_per_s + self._liars_bytes_per_s:
            raise UsageError(
                f"evidence_bytes_per_s is {self.evidence_bytes_per_s}, less than the rate of all other log entries",
                f"at least {math.ceil(self._entries_bytes_per_s + self._liars_bytes_per_s)}",
            )
        if self.delta_ms * 2 >= self.t_control_ms:
            raise UsageError(
                f"delta_ms is {self.delta_ms}, not below half of t_control_ms, {self.t_control_ms}",
                "use a smaller delta_ms or a larger t_control_ms",
            )

    @property
    def tokens_needed(self) -> int:
        """Return `tokens_of` this f_max."""
        return tokens_of(self.f_max)

    @property
    def quorum(self) -> int:
        """Return `quorum_of` this f_max."""
        return quorum_of(self.f_max)

    @property
    def least_robots(self) -> int:
        """Return the least robots in mutual range of which f_max may be compromised while the others have a quorum."""
        return self.f_max + self.quorum + 1

    def stop_bound_ms(self, *, output_missing: bool) -> int:
        """Return the longest time from a robot's deviation to Safe Mode; δ + skew more if an output is missing or late.

        Source: docs/promises.md (P1).
        """
        return self.t_val_ms + self.p_check_ms + 1 + (self.delta_ms + self.skew_ms) * output_missing

    @property
    def log_bytes_per_s(self) -> float:
        """Return the growth of the log with `n_max` neighbours in range (RoboRebound §5.2: 806.67 B/s at 24)."""
        return self._entries_bytes_per_s + self.evidence_bytes_per_s

    @property
    def _entries_bytes_per_s(self) -> float:
        state_period_s = self.t_control_ms * self.steps_per_state / 1000
        alone = 2 * ENTRY_HEAD_BYTES + self.reading_bytes + self.command_bytes
        alone += ADVICE_HEAD_BYTES + self.advice_bytes if self.advice_bytes else 0
        return (self.n_max + 1) * STATE_ENTRY_BYTES / state_period_s + alone * 1000 / self.t_control_ms

    @property
    def _liars_bytes_per_s(self) -> float:
        return self.f_max * LIAR_BYTES * 1000 / (self.t_control_ms * self.steps_per_state)

    @property
    def log_capacity_bytes(self) -> int:
        """Return the capacity of a log: a correct robot is in Safe Mode before its log is full.

        It includes the packets of compromised neighbours: their a-nodes limit what they send per state period to the
        airtime of four states, which one long packet may use.
        """
        return math.ceil(1.3 * (self.t_val_ms / 1000) * (self.log_bytes_per_s + self._liars_bytes_per_s)) + 1024

    @property
    def checkpoint_capacity_bytes(self) -> int:
        """Return the length of the longest checkpoint."""
        return max(CHECKPOINT_BYTES + (self.state_bytes or NEIGHBOUR_BYTES * self.n_max), 512)

    @property
    def request_capacity_bytes(self) -> int:
        """Return the length of the longest audit request that is sent or accepted."""
        return self.log_capacity_bytes + self.checkpoint_capacity_bytes + REQUEST_OVERHEAD_BYTES

    @property
    def audits_taken(self) -> int:
        """Return how many requests a robot audits per T_val at most: one per neighbour and T_audit / 2 (ADR 0027)."""
        return self.n_max * -(-2 * self.t_val_ms // self.t_audit_ms)

    @property
    def tokens_kept(self) -> int:
        """Return how many tokens a c-node stores for a checkpoint at most."""
        return 2 * self.f_max + 1
