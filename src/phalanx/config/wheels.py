"""What a mission says of robots that visitors drive."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.errors import UsageError

from .parameter import check_limits, within

KEY_BYTES = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Parameters of robots on two wheels that visitors drive.

    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md (300 ms); RoboRebound §4 (the periods); docs/spec/orders.md (whom they obey).
    """

    good_ms: int = within(300, 1, 60_000)  # a joystick's word is obeyed for so long, then the wheels stop
    state_every: int = within(6, 1, 1000)  # broadcast at each so manieth control step
    mission: int = within(1, 1, 2**32 - 1)  # its number, as the mission key has it: orders of another are not obeyed
    # Signatures looked at from one reading to the next: true ones are one or two. Of false ones a liar's a-node lets
    # out two at once, and then not two a second (`bound`).
    looks: int = within(16, 1, 255)
    gateway_key: bytes = b""  # Ed25519, public: who may give orders; empty for nobody
    operator_key: bytes = b""  # the same

    def __post_init__(self) -> None:
        check_limits(self)
        for name in ("gateway_key", "operator_key"):
            if len(getattr(self, name)) not in (0, KEY_BYTES):
                raise UsageError(f"{name} has {len(getattr(self, name))} bytes", f"an Ed25519 public key, {KEY_BYTES}")
