"""The pin: the one secret that a QR code carries (Qrkey §III-D)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from phalanx.errors import UsageError

_DIGITS = re.compile(r"[0-9]{4,64}", re.ASCII)


class BadPin(UsageError):
    """Not 4 to 64 decimal digits. The message never repeats what was given: it may be a mistyped secret."""

    def __init__(self) -> None:
        super().__init__("the pin is not 4 to 64 digits", "copy it from the operator's page, leading zeros included")


@dataclass(frozen=True, slots=True, repr=False)
class Pin:
    """Decimal digits as text: leading zeros count. Raises: BadPin."""

    digits: str

    def __post_init__(self) -> None:
        if not isinstance(self.digits, str) or not _DIGITS.fullmatch(self.digits):
            raise BadPin

    def __repr__(self) -> str:
        return "<Pin>"


def new_pin(digits: int, random_bytes: Callable[[int], bytes]) -> Pin:
    """A pin of so many digits, each equally likely; `random_bytes` makes n bytes from a cryptographic source."""
    chosen = ""
    while len(chosen) < digits:
        # 250 is the last multiple of 10 in a byte; keeping 250..255 would favour the digits 0 to 5.
        chosen += "".join(str(byte % 10) for byte in random_bytes(digits) if byte < 250)
    return Pin(chosen[:digits])
