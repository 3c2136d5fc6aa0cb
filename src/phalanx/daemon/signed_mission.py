"""The owner's signature over the mission for which a key was issued: a robot's evidence cannot name another one.

The signature is in the file of the mission key, and is copied to the robot's log. It covers the mission's number and
its settings except the name and simulated attacks.
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

# The same key signs encoded missions, with another context.
CONTEXT = b"phalanx swarm mission 1\x00"


@dataclass(frozen=True, slots=True)
class SignedMission:
    """The owner's signature over a mission and its number; digest, public key and signature in hexadecimal."""

    number: int
    digest: str
    signer: str
    signature: str

    @classmethod
    def of(cls, entry: Any) -> Self | None:
        """Parse a file's field; None if absent. Raises: ValueError, TypeError, KeyError: it is malformed."""
        if entry is None:
            return None
        texts = {name: bytes.fromhex(entry[name]).hex() for name in ("digest", "signer", "signature")}
        return cls(int(entry["number"]), **texts)

    @property
    def as_json(self) -> dict[str, Any]:
        """Return the fields, as `of` reads them."""
        return asdict(self)

    def is_of(self, scenario: Scenario, number: int) -> bool:
        """Return whether it is for this mission and number and validly signed by its named signer, whoever that is."""
        if self.number != number or self.digest != digest_of(scenario):
            return False
        try:
            signer = Ed25519PublicKey.from_public_bytes(bytes.fromhex(self.signer))
            signer.verify(bytes.fromhex(self.signature), _signed(self.number, self.digest))
        except (InvalidSignature, ValueError):
            return False
        return True


def digest_of(scenario: Scenario) -> str:
    """Return the SHA-256 (hex) of the settings that a mission's robots share, equal for sealed and plain radios."""
    packet_max = min(scenario.bti.packet_max_bytes, PACKET_MAX - SEAL.size)
    common = replace(scenario, name="", attacks=(), bti=replace(scenario.bti, packet_max_bytes=packet_max))
    return hashlib.sha256(json.dumps(written_scenario(common), sort_keys=True).encode()).hexdigest()


def sign_mission(scenario: Scenario, number: int, key: Ed25519PrivateKey) -> SignedMission:
    """Sign a mission as the owner. Source: RFC 8032 (Ed25519)."""
    digest, signer = digest_of(scenario), key.public_key().public_bytes_raw().hex()
    return SignedMission(number, digest, signer, key.sign(_signed(number, digest)).hex())


def _signed(number: int, digest: str) -> bytes:
    return CONTEXT + f"{number} {digest}".encode()


def signed_for(issued: Path, scenario: Scenario, mission: str) -> SignedMission | None:
    """Return the signed mission in a mission key's file. Raises: UsageError: of another mission; Unavailable."""
    hint = "use a file that phalanx keys issue wrote"
    try:
        content = json.loads(read_at_most(issued, MOST_BYTES, hint))
        number, signed = int(content["mission"]), SignedMission.of(content.get("signed"))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{issued} is not a mission key", hint) from error
    if signed and not signed.is_of(scenario, number):
        raise UsageError(
            f"{issued} was issued for another mission than {mission}", "use the two files as they were issued"
        )
    return signed
