"""Who wrote a mission, and whether a robot may start it: signature, names, window, and once."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from phalanx.errors import NotAuthentic
from phalanx.mission.refused import AlreadyStarted, NotForUs, OutsideWindow, Unsigned

from .records import FOREVER_S, REPEATABLE, EncodedMission

# An Ed25519 key of the operator signs nothing else by accident.
CONTEXT = b"phalanx mission file 1\x00"


def public_key(key: Ed25519PrivateKey) -> bytes:
    """The 32 bytes that robots trust."""
    return key.public_key().public_bytes_raw()


def sign(mission: EncodedMission, key: Ed25519PrivateKey) -> EncodedMission:
    """The mission with a signature over all of it. Source: RFC 8032 (Ed25519)."""
    bare = replace(mission, signer=b"", signature=b"")
    return replace(bare, signer=public_key(key), signature=key.sign(CONTEXT + bare.signed_part()))


def check_signature(mission: EncodedMission, trusted: Collection[bytes] | None) -> None:
    """Nothing, if the mission was signed by somebody trusted and is unaltered.

    Args:
        trusted: public keys, 32 bytes each; None takes whoever signed, and proves only that nothing was altered since.
    Raises: Unsigned, NotAuthentic.
    """
    if not mission.signer:
        raise Unsigned("nobody signed this mission")
    if trusted is not None and mission.signer not in trusted:
        raise Unsigned(f"signed by {mission.signer.hex()}, who is not trusted")
    try:
        Ed25519PublicKey.from_public_bytes(mission.signer).verify(mission.signature, CONTEXT + mission.signed_part())
    except (InvalidSignature, ValueError) as error:
        raise NotAuthentic("the signature does not verify: another key, or altered on the way") from error


def admit(mission: EncodedMission, robot: int, now_s: float, started: Collection[bytes]) -> None:
    """Nothing, if this robot may start the mission now.

    Args:
        now_s: on the mission's clock.
        started: ids of missions that it has started before; a robot keeps them where it forgets nothing.
    Raises: NotForUs, OutsideWindow, AlreadyStarted.
    Source: Encoded graphs §VI-G (replay).
    """
    header = mission.header
    if header.robots and robot not in header.robots:
        raise NotForUs(f"the mission is for robots {', '.join(map(str, header.robots))}, this is {robot}")
    ends = header.valid_to_s if header.valid_to_s < FOREVER_S else float("inf")
    if not header.valid_from_s <= now_s < ends:
        raise OutsideWindow(f"valid from {header.valid_from_s} s to {ends:g} s, now is {now_s:.0f} s")
    if header.mission_id in started and not header.flags & REPEATABLE:
        raise AlreadyStarted("this robot has started this mission before")
