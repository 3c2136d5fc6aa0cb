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
# Of log, per state period: a packet that takes as much airtime as four states, less the state it replaces.
LIAR_BYTES = 376
# Of one request; a fragment's number and their count are a byte, and a bit each in a word says which have come.
MOST_FRAGMENTS = 63
FRAGMENT_HEAD_BYTES = 10
MOST_CHECKPOINT_BYTES = 65_535


def tokens_of(f_max: int) -> int:
    """Return how many fresh tokens of different auditors keep a robot alive."""
    return f_max + 1


def quorum_of(f_max: int) -> int:
    """Return how many correct robots must hear a robot, and be heard by it, for P2 to hold for that robot.

    One more than the tokens that it needs: compromised robots may talk over one auditor. Source: docs/promises.md.
    """
    return tokens_of(f_max) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class BtiConfig:
    """Parameters of the audits; the paper's values where it gives one.

    Raises: UsageError: a value is out of range. Source: RoboRebound §4, §5.2; docs/spec/rebound.md.
    """

    f_max: int = within(
        3, 1, 15, "the most compromised robots that a mission tolerates; f_max + 1 fresh tokens keep a robot alive"
    )
    t_audit_ms: int = within(4000, 500, 600_000, "a round of audits is asked for so often")
    t_val_ms: int = within(10_000, 1000, 3_600_000, "how long a token counts")
    t_control_ms: int = within(250, 20, 10_000, "period of the sensors' grid")
    steps_per_state: int = within(6, 1, 1000, "control periods from one state broadcast to the next (1.5 s)")
    p_check_ms: int = within(100, 1, 100, "period of the a-node's CheckTokens")
    delta_ms: int = within(
        100, 1, 1000, "an output comes within so much of its cause, a sensor reading within so much of its grid"
    )
    skew_ms: int = within(50, 1, 1000, "the log departs from the order of time by at most so much")
    retry_ms: int = within(50, 5, 10_000, "after so long without enough tokens, further robots are asked")
    batch_size: int = within(10, 1, 255, "entries that go into one link of a hash chain")
    n_max: int = within(
        24, 1, 400, "neighbours that storage and airtime are provided for; at least a quorum, f_max + 2"
    )
    packet_max_bytes: int = within(2048, 256, 2048, "longest radio packet")
    reading_bytes: int = within(27, 1, 2048, "of a sensor reading as it is chained")
    command_bytes: int = within(19, 1, 2048, "of what goes to the actuators each control period")
    state_bytes: int = within(
        0, 0, MOST_CHECKPOINT_BYTES - CHECKPOINT_BYTES, "of the controller at most; 0: a flock's with n_max neighbours"
    )
    advice_bytes: int = within(0, 0, 255, "of what a planner says each control period; 0: there is none")
    evidence_max_bytes: int = within(0, 0, 65_535, "longest piece that a log may hold beside a reading; 0: none")
    evidence_bytes_per_s: int = within(0, 0, 1_000_000, "what the log has room for of it, on the mean")

    def __post_init__(self) -> None:
        check_limits(self)
        if self.n_max < self.quorum:
            raise UsageError(
                f"n_max is {self.n_max}, and a quorum with f_max {self.f_max} is {self.quorum} neighbours",
                f"n_max {self.quorum} or more, or a smaller f_max",
            )
        if self.t_val_ms < self.t_audit_ms * 3 // 2:
            raise UsageError(
                f"tokens count for {self.t_val_ms / 1000:g} s and a round of audits comes every "
                f"{self.t_audit_ms / 1000:g} s",
                "t_val at least 1.5 times t_audit, or honest robots starve",
            )
        fragments = -(-self.request_capacity_bytes // (self.packet_max_bytes - FRAGMENT_HEAD_BYTES))
        if fragments > MOST_FRAGMENTS:
            raise UsageError(
                f"an audit request of {self.request_capacity_bytes} bytes takes {fragments} packets",
                f"at most {MOST_FRAGMENTS}: a shorter t_val, a smaller n_max or longer packets",
            )
        # Evidence is kept while the log is less than half full: the rest is for what comes without being asked.
        if self.evidence_max_bytes and self.evidence_bytes_per_s < self._entries_bytes_per_s + self._liars_bytes_per_s:
            raise UsageError(
                f"room for {self.evidence_bytes_per_s} bytes of evidence a second",
                "at least as much as for all else in a log",
            )
        if self.delta_ms * 2 >= self.t_control_ms:
            raise UsageError(
                f"readings within {self.delta_ms} ms of a grid of {self.t_control_ms} ms", "delta below half a period"
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
        """Return the robots in one radio range of which f_max may be compromised and each correct one has a quorum."""
        return self.f_max + self.quorum + 1

    def stop_bound_ms(self, *, output_missing: bool) -> int:
        """From deviation to Safe Mode, at most; δ + skew more if an output is missing or late.

        Source: docs/promises.md (P1).
        """
        return self.t_val_ms + self.p_check_ms + 1 + (self.delta_ms + self.skew_ms) * output_missing

    @property
    def log_bytes_per_s(self) -> float:
        """Growth of the log with `n_max` neighbours in range (RoboRebound §5.2: 806.67 B/s at 24)."""
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
        """Bytes of log that a robot keeps: it is in Safe Mode before honest work fills them.

        A compromised robot may have its neighbours log more than its share: its a-node limits the airtime of what it
        sends to four states' each state period, and one long packet takes no more than four short ones.
        """
        return math.ceil(1.3 * (self.t_val_ms / 1000) * (self.log_bytes_per_s + self._liars_bytes_per_s)) + 1024

    @property
    def checkpoint_capacity_bytes(self) -> int:
        """Longest checkpoint."""
        return max(CHECKPOINT_BYTES + (self.state_bytes or NEIGHBOUR_BYTES * self.n_max), 512)

    @property
    def request_capacity_bytes(self) -> int:
        """Longest audit request that is sent or read."""
        return self.log_capacity_bytes + self.checkpoint_capacity_bytes + REQUEST_OVERHEAD_BYTES

    @property
    def audits_taken(self) -> int:
        """Requests that a robot audits per T_val at most: each neighbour's share, one a T_audit / 2 (docs/adr/0027)."""
        return self.n_max * -(-2 * self.t_val_ms // self.t_audit_ms)

    @property
    def tokens_kept(self) -> int:
        """Tokens that a c-node keeps at most."""
        return 2 * self.f_max + 1
