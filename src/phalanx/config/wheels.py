"""What a mission says of robots that visitors drive."""

from __future__ import annotations

from dataclasses import dataclass

from .parameter import check_limits, within


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Parameters of robots on two wheels that visitors drive.

    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md (300 ms); RoboRebound §4 (the periods).
    """

    good_ms: int = within(300, 1, 60_000)  # a joystick's word is obeyed for so long, then the wheels stop
    state_every: int = within(6, 1, 1000)  # broadcast at each so manieth control step

    def __post_init__(self) -> None:
        check_limits(self)
