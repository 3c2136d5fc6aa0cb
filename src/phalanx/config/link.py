"""Parameters of the link in mode qrkey."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from phalanx.errors import UsageError

_ROOT = re.compile(r"/[0-9A-Za-z_-]{1,64}(/[0-9A-Za-z_-]{1,64}){0,7}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConfig:
    """Parameters of the link in mode qrkey; the defaults are the paper's, except for the longer pin.

    Raises: UsageError: a value is out of range. Source: Qrkey §III-D; docs/spec/link.md.
    """

    root: str = "/qrkey"  # first part of every topic, with its leading slash
    pin_digits: int = 39  # of the pins that a server makes; the paper's 12 can be brute-forced offline
    rotate_s: float = 900.0  # lifetime of a pin
    overlap_s: float = 120.0  # for which both the old and the new pin are accepted
    tolerance_s: float = 30.0  # largest difference between a message's timestamp and the receiver's clock
    max_to_server_bytes: int = 48 * 1024  # longest plaintext that a server reads
    max_to_client_bytes: int = 1024 * 1024  # longest plaintext that a client reads
    replay_capacity: int = 200_000  # messages in the replay cache of each receiver
    knock_gap_s: float = 1.0  # shortest time between two pin messages for late phones

    def __post_init__(self) -> None:
        if not _ROOT.fullmatch(self.root):
            raise UsageError(
                f"root {self.root!r} is not a topic", "use a slash and letters, digits, - or _, like /qrkey"
            )
        if not 12 <= self.pin_digits <= 64:
            raise UsageError(f"pin_digits is {self.pin_digits}", "12 (the paper's) to 64; 39 digits have 129 bits")
        for name in ("rotate_s", "overlap_s", "tolerance_s", "knock_gap_s"):
            value = getattr(self, name)
            if not math.isfinite(value) or value <= 0:
                raise UsageError(f"{name} is {value}", "a positive number of seconds")
        if self.overlap_s >= self.rotate_s:
            raise UsageError(
                f"overlap_s is {self.overlap_s:g}, not shorter than rotate_s, {self.rotate_s:g}",
                "use a smaller overlap_s or a larger rotate_s",
            )
        for name in ("max_to_server_bytes", "max_to_client_bytes", "replay_capacity"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} is {getattr(self, name)}", "at least 1")
