"""Which mission a mission's key was issued for, signed by the owner: so a robot's evidence does not choose its own.

The signature is in the file of the mission's key and goes with a robot's log. It covers the mission's number and all
that the mission says but its name and who rehearses attacks.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from phalanx.config.written import read_at_most
from phalanx.errors import UsageError
from phalanx.net.mission_key import MOST_BYTES
from phalanx.scenarios.file import written_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import PACKET_MAX, SEAL

# The key signs encoded missions too, behind a context of their own.
CONTEXT = b"phalanx swarm mission 1\x00"


@dataclass(frozen=True, slots=True)
class SignedMission:
    """The owner's word that this is the mission of that number; digest, public key and signature in hexadecimal."""

    number: int
    digest: str
    signer: str
    signature: str

    @classmethod
    def of(cls, said: Any) -> Self | None:
        """Return what a file says, None if nothing. Raises: ValueError, TypeError, KeyError: it is no such thing."""
        if said is None:
            return None
        texts = {name: bytes.fromhex(said[name]).hex() for name in ("digest", "signer", "signature")}
        return cls(int(said["number"]), **texts)

    @property
    def told(self) -> dict[str, Any]:
        """As `of` reads it."""
        return asdict(self)

    def is_of(self, scenario: Scenario, number: int) -> bool:
        """Return whether it has that mission number and its named signer's signature; not whether he is the owner."""
        if self.number != number or self.digest != digest_of(scenario):
            return False
        try:
            signer = Ed25519PublicKey.from_public_bytes(bytes.fromhex(self.signer))
            signer.verify(bytes.fromhex(self.signature), _signed(self.number, self.digest))
        except (InvalidSignature, ValueError):
            return False
        return True


def digest_of(scenario: Scenario) -> str:
    """SHA-256 of what robots of a mission have in common, in hexadecimal; the same with a sealed radio and without."""
    packet_max = min(scenario.bti.packet_max_bytes, PACKET_MAX - SEAL.size)
    common = replace(scenario, name="", attacks=(), bti=replace(scenario.bti, packet_max_bytes=packet_max))
    return hashlib.sha256(json.dumps(written_scenario(common), sort_keys=True).encode()).hexdigest()


def sign_mission(scenario: Scenario, number: int, key: Ed25519PrivateKey) -> SignedMission:
    """The owner's word for it. Source: RFC 8032 (Ed25519)."""
    digest, signer = digest_of(scenario), key.public_key().public_bytes_raw().hex()
    return SignedMission(number, digest, signer, key.sign(_signed(number, digest)).hex())


def _signed(number: int, digest: str) -> bytes:
    return CONTEXT + f"{number} {digest}".encode()


def signed_for(issued: Path, scenario: Scenario, mission: str) -> SignedMission | None:
    """Return what a mission key's file says of its mission. Raises: UsageError: it is another's; Unavailable."""
    try:
        told = json.loads(read_at_most(issued, MOST_BYTES, "phalanx keys issue makes one"))
        number, signed = int(told["mission"]), SignedMission.of(told.get("signed"))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{issued} is no mission key", "phalanx keys issue makes one") from error
    if signed and not signed.is_of(scenario, number):
        raise UsageError(
            f"{issued} was issued for another mission than {mission}", "the same two files for all, as they were issued"
        )
    return signed
