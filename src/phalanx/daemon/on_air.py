"""Attacks by a radio that bypasses the a-node: an attacker on the robot's computer controls its radio.

The c-node is honest and its log is true, so no audit can detect these. Source: docs/spec/sealed-radio.md.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from phalanx.errors import UsageError, did_you_mean
from phalanx.net.udp_radio import Radio
from phalanx.wire.table import SEAL, STATE

AGAIN_S = (0.02, 1.0, 3.0)  # delays after which a packet is repeated
HELD_S = 3.0
HINT = "use NAME[:robot=I,at=T], such as replay:robot=2,at=5"
AT_ID = STATE.at("id")


@dataclass(frozen=True, slots=True)
class RadioAttack:
    """An attack by one robot's radio, and its start, seconds after the radio's first use."""

    name: str
    robot: int = 1
    at_s: float = 5.0


class HostileRadio:
    """A radio that also attacks; its times are of a clock that runs at `speed` of real time."""

    def __init__(self, radio: Radio, attack: RadioAttack, speed: float = 1.0) -> None:
        self._radio, self._attack, self._speed = radio, attack, speed
        self._began_s = 0.0

    @property
    def refused(self) -> Mapping[str, int]:
        """See `Radio`."""
        return self._radio.refused

    def send(self, packet: bytes) -> None:
        """See `Radio`."""
        attacks = self._is_attacking
        if attacks and self._attack.name == "hold":
            self._later(HELD_S, packet)
            return
        self._radio.send(packet)
        if attacks:
            self._send_more(packet)

    def take(self) -> bytes:
        """See `Radio`."""
        attacks, packet = self._is_attacking, self._radio.take()
        if packet and attacks and self._attack.name == "replay":
            self._send_more(packet)
        return packet

    def fileno(self) -> int:
        """See `Radio`."""
        return self._radio.fileno()

    @property
    def _is_attacking(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        self._began_s = self._began_s or now_s
        return (now_s - self._began_s) * self._speed >= self._attack.at_s

    def _later(self, after_s: float, packet: bytes) -> None:
        asyncio.get_running_loop().call_later(after_s / self._speed, self._radio.send, packet)

    def _send_more(self, packet: bytes) -> None:
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


# Bypass the a-node, repeat received and sent packets, delay packets, use another mission's key.
ATTACKS = ("past", "replay", "hold", "foreign-key")


def parse_on_air(words: str, robots: int) -> RadioAttack:
    """Parse an attack. Raises: UsageError: no such attack, option or robot."""
    name, _, rest = words.partition(":")
    options = dict(each.partition("=")[::2] for each in filter(None, rest.split(",")))
    try:
        attack = RadioAttack(name, int(options.pop("robot", "1")), float(options.pop("at", "5")))
    except ValueError as error:
        raise UsageError(f"--on-air {words}: {error}", HINT) from error
    if name not in ATTACKS or options:
        wrong, known = (next(iter(options), ""), ("robot", "at")) if name in ATTACKS else (name, ATTACKS)
        near = did_you_mean(wrong, known)
        raise UsageError(f"--on-air {words}: no such attack or option", f"{near}one of {', '.join(ATTACKS)}; {HINT}")
    if not 1 <= attack.robot <= robots or not 0 <= attack.at_s < 1e9:
        raise UsageError(f"--on-air {words}: robot or time is out of range", f"use a robot from 1 to {robots}")
    return attack
