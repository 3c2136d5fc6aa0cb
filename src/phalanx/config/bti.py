"""Parameters of bounded-time interaction, and the sizes and rates that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.errors import UsageError

# Bytes that the log grows by per second without any neighbour: 4 sensor readings of 34 B and 4 commands of 26 B.
LOG_ALONE_BYTES_PER_S = 240
REQUEST_OVERHEAD_BYTES = 300
CHECKPOINT_BYTES = 66
NEIGHBOUR_BYTES = 26
STATE_ENTRY_BYTES = 34
# Of log, per state period: a frame that takes as much airtime as four states, less the state it replaces.
LIAR_BYTES = 376
# Of one request; a fragment's number and their count are a byte, and a bit each in a word says which have come.
MOST_FRAGMENTS = 63
FRAGMENT_HEAD_BYTES = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class BtiConfig:
    """Parameters of the audits; the paper's values where it gives one.

    Args:
        f_max: compromised robots that are tolerated; f_max + 1 fresh tokens keep a robot alive.
        t_audit_ms: a round of audits is asked for so often.
        t_val_ms: how long a token counts.
        t_control_ms: period of the sensors' grid.
        steps_per_state: control periods from one state broadcast to the next (1.5 s).
        p_check_ms: period of the a-node's CheckTokens.
        delta_ms: an output comes within so much of its cause, a sensor reading within so much of its grid.
        skew_ms: the log departs from the order of time by at most so much.
        retry_ms: after so long without enough tokens, further robots are asked.
        batch_size: entries that go into one link of a hash chain.
        n_max: neighbours that storage and airtime are provided for.
        frame_max_bytes: longest radio frame.
    Raises: UsageError: a value is out of range.
    Source: RoboRebound §4, §5.2; docs/spec/rebound.md.
    """

    f_max: int = 3
    t_audit_ms: int = 4000
    t_val_ms: int = 10_000
    t_control_ms: int = 250
    steps_per_state: int = 6
    p_check_ms: int = 100
    delta_ms: int = 100
    skew_ms: int = 50
    retry_ms: int = 50
    batch_size: int = 10
    n_max: int = 24
    frame_max_bytes: int = 2048

    def __post_init__(self) -> None:
        limits = {
            "f_max": (1, 15),
            "t_audit_ms": (500, 600_000),
            "t_val_ms": (1000, 3_600_000),
            "t_control_ms": (20, 10_000),
            "steps_per_state": (1, 1000),
            "p_check_ms": (1, 100),
            "delta_ms": (1, 1000),
            "skew_ms": (1, 1000),
            "retry_ms": (5, 10_000),
            "batch_size": (1, 255),
            "n_max": (self.f_max + 1, 400),
            "frame_max_bytes": (256, 2048),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise UsageError(f"{name} is {getattr(self, name)}", f"{low} to {high}")
        if self.t_val_ms < self.t_audit_ms * 3 // 2:
            raise UsageError(
                f"tokens count for {self.t_val_ms} ms and a round of audits comes every {self.t_audit_ms} ms",
                "t_val at least 1.5 times t_audit, or honest robots starve",
            )

        fragments = -(-self.request_capacity_bytes // (self.frame_max_bytes - FRAGMENT_HEAD_BYTES))
        if fragments > MOST_FRAGMENTS:
            raise UsageError(
                f"an audit request of {self.request_capacity_bytes} bytes takes {fragments} frames",
                f"at most {MOST_FRAGMENTS}: a shorter t_val, a smaller n_max or longer frames",
            )
        if self.delta_ms * 2 >= self.t_control_ms:
            raise UsageError(
                f"readings within {self.delta_ms} ms of a grid of {self.t_control_ms} ms", "delta below half a period"
            )

    @property
    def tokens_needed(self) -> int:
        """Fresh tokens of different auditors that keep a robot alive."""
        return self.f_max + 1

    @property
    def log_bytes_per_s(self) -> float:
        """Growth of the log with `n_max` neighbours in range (RoboRebound §5.2: 806.67 B/s at 24)."""
        state_period_s = self.t_control_ms * self.steps_per_state / 1000
        return (self.n_max + 1) * STATE_ENTRY_BYTES / state_period_s + LOG_ALONE_BYTES_PER_S * 250 / self.t_control_ms

    @property
    def log_capacity_bytes(self) -> int:
        """Bytes of log that a robot keeps: it is in Safe Mode before honest work fills them.

        A liar may have its neighbours log more than its share: its a-node limits the airtime of what it sends to four
        states' each state period, and one long frame takes no more than four short ones.
        """
        liars = self.f_max * LIAR_BYTES * 1000 / (self.t_control_ms * self.steps_per_state)
        return math.ceil(1.3 * (self.t_val_ms / 1000) * (self.log_bytes_per_s + liars)) + 1024

    @property
    def checkpoint_capacity_bytes(self) -> int:
        """Longest checkpoint."""
        return max(CHECKPOINT_BYTES + NEIGHBOUR_BYTES * self.n_max, 512)

    @property
    def request_capacity_bytes(self) -> int:
        """Longest audit request that is sent or read."""
        return self.log_capacity_bytes + self.checkpoint_capacity_bytes + REQUEST_OVERHEAD_BYTES

    @property
    def audits_taken(self) -> int:
        """Requests that a robot audits per T_val at most (docs/adr/0015)."""
        return 12 * self.f_max

    @property
    def tokens_kept(self) -> int:
        """Tokens that an a-node and a c-node keep at most."""
        return 2 * self.f_max + 1
