"""Attacks between an a-node and the air: who has a robot's computer has its radio, whatever the a-node lets through.

The c-node above is honest, and its log is true: no audit sees any of this. Source: docs/spec/sealed-radio.md.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from phalanx.errors import UsageError, did_you_mean
from phalanx.net.udp_radio import Radio
from phalanx.wire.table import SEAL, STATE

AGAIN_S = (0.02, 1.0, 3.0)  # after so long what was heard or said is said again
HELD_S = 3.0
HINT = "NAME[:robot=I,at=T], as replay:robot=2,at=5"
AT_ID = STATE.at("id")


@dataclass(frozen=True, slots=True)
class OnAir:
    """Which robot's radio does what, and from when on, seconds since it was first asked what it hears."""

    name: str
    robot: int = 1
    at_s: float = 5.0


class HostileRadio:
    """A radio that does what is asked for, and more; its times are of a clock at `speed` of true time."""

    def __init__(self, radio: Radio, attack: OnAir, speed: float = 1.0) -> None:
        self._radio, self._attack, self._speed = radio, attack, speed
        self._began_s = 0.0

    @property
    def refused(self) -> Mapping[str, int]:
        """See `Radio`."""
        return self._radio.refused

    def send(self, packet: bytes) -> None:
        """See `Radio`."""
        lies = self._lies
        if lies and self._attack.name == "hold":
            self._later(HELD_S, packet)
            return
        self._radio.send(packet)
        if lies:
            self._more(packet)

    def take(self) -> bytes:
        """See `Radio`."""
        lies, packet = self._lies, self._radio.take()
        if packet and lies and self._attack.name == "replay":
            self._more(packet)
        return packet

    def fileno(self) -> int:
        """See `Radio`."""
        return self._radio.fileno()

    @property
    def _lies(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        self._began_s = self._began_s or now_s
        return (now_s - self._began_s) * self._speed >= self._attack.at_s

    def _later(self, after_s: float, packet: bytes) -> None:
        asyncio.get_running_loop().call_later(after_s / self._speed, self._radio.send, packet)

    def _more(self, packet: bytes) -> None:
        if self._attack.name == "replay":
            for each_s in AGAIN_S:
                self._later(each_s, packet)
        elif self._attack.name == "past":
            for each in forgeries(packet):
                self._radio.send(each)


def forgeries(packet: bytes) -> list[bytes]:
    """Return forgeries of a sealed packet: without its seal, altered, with another sender, too long."""
    altered, named = bytearray(packet), bytearray(packet)
    altered[-SEAL.size - 1] ^= 1
    named[AT_ID] ^= 3
    return [packet[: -SEAL.size], bytes(altered), bytes(named), packet + packet[-SEAL.size :]]


# To speak past the a-node, to repeat what was heard and said, to be late, and to have another mission's key.
ATTACKS = ("past", "replay", "hold", "foreign-key")


def parse_on_air(words: str, robots: int) -> OnAir:
    """The attack that is meant. Raises: UsageError: there is none such."""
    name, _, rest = words.partition(":")
    said = dict(each.partition("=")[::2] for each in filter(None, rest.split(",")))
    try:
        attack = OnAir(name, int(said.pop("robot", "1")), float(said.pop("at", "5")))
    except ValueError as error:
        raise UsageError(f"--on-air {words}: {error}", HINT) from error
    if name not in ATTACKS or said:
        near = did_you_mean(next(iter(said), ""), ("robot", "at")) if name in ATTACKS else did_you_mean(name, ATTACKS)
        raise UsageError(f"--on-air {words}: no such attack or option", f"{near}{', '.join(ATTACKS)}; {HINT}")
    if not 1 <= attack.robot <= robots or not 0 <= attack.at_s < 1e9:
        raise UsageError(f"--on-air {words}: robot or time is out of range", f"robots are 1 to {robots}")
    return attack
