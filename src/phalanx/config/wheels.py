"""What a mission says of robots that visitors drive."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Parameters of robots on two wheels that visitors drive.

    Args:
        good_ms: a joystick's word is obeyed for so long, then the wheels stop.
        state_every: broadcast at each so manieth control step.
    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md (300 ms); RoboRebound §4 (the periods).
    """

    good_ms: int = 300
    state_every: int = 6

    def __post_init__(self) -> None:
        for name, value, most in (("good_ms", self.good_ms, 60_000), ("state_every", self.state_every, 1000)):
            if not 1 <= value <= most:
                raise UsageError(f"{name} is {value}", f"1 to {most}")
