"""Attacks on a mission file in transit: altering, replacing and replaying it."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.errors import UsageError
from phalanx.mission import BuildOptions, Landmark, Observable, Profile, build, parse_mission, parse_start_key, sign
from phalanx.mission.graph import Node

from .between import Between, Sent

BYTE = 8
MM_PER_M = 1000


class FlipBit(Between):
    """Flip one bit of the signed part: bit `bit=N`, or a random one.

    In the plain graph, flip the bit of the last node's position that stands for four metres.
    """

    PLACE_BIT: ClassVar[int] = 12  # of millimetres: 4.096 m

    def deliver(self, sent: Sent) -> Sent:
        """Return the file with the bit flipped. Raises: UsageError: the file has no such bit."""
        bits = BYTE * len(parse_mission(sent.file).signed_part())
        asked = float(self.plan.options.get("bit", self.plan.chance.integers(bits)))
        if not 0 <= asked < bits:
            raise UsageError(f"bit {asked:g} of a mission", f"0 to {bits - 1}")
        bit = int(asked)
        altered = bytearray(sent.file)
        altered[bit // BYTE] ^= 1 << bit % BYTE
        nodes = tuple(self._moved(node) if node.final else node for node in sent.plain.nodes)
        return replace(sent, file=bytes(altered), plain=replace(sent.plain, nodes=nodes))

    def _moved(self, node: Node) -> Node:
        return replace(node, see=tuple(tuple(map(self._elsewhere, alias)) for alias in node.see))

    def _elsewhere(self, thing: Observable) -> Observable:
        if not isinstance(thing, Landmark):
            return thing
        return replace(thing, x_m=(round(thing.x_m * MM_PER_M) ^ 1 << self.PLACE_BIT) / MM_PER_M)


class ForgeGraph(Between):
    """Replace the mission by the attacker's own, written from a floor plan and signed with an untrusted key.

    In `paper` missions carry no signature. An attacker who has guessed the nodes of a mission could also alter it.
    """

    ordered = False

    def deliver(self, sent: Sent) -> Sent:
        header = parse_mission(sent.file).header
        made = build(
            replace(self.plan.wanted, coding=header.coding),
            BuildOptions(profile=header.profile),
            self.plan.chance.bytes,
        )[0]
        mission = made.mission
        if header.profile is Profile.SEALED:
            mission = sign(mission, Ed25519PrivateKey.from_private_bytes(self.plan.chance.bytes(32)))
        return Sent(self.plan.wanted, mission.encode(), made.key.encode(), ())


class ReplayDay(Between):
    """Replay the operator's mission of another day, when none was ordered: a weakness of the paper (§VI-G)."""

    ordered = False

    def deliver(self, sent: Sent) -> Sent:
        return self.plan.yesterday


class ReplayRobot(ReplayDay):
    """Deliver the operator's mission for another robot."""

    def deliver(self, sent: Sent) -> Sent:
        return self.plan.others


class ReplayAgain(Between):
    """Deliver today's mission once more, after the robot has completed it."""

    ordered, again = False, True


class SetClock(ReplayDay):
    """Hold yesterday's mission back, and deliver it today with the robot's clock set back by a day."""

    clock_s = -86_400.0


class SwapKey(Between):
    """Deliver the start key of another day with today's mission."""

    def deliver(self, sent: Sent) -> Sent:
        key = replace(parse_start_key(self.plan.yesterday.key), mission_id=parse_start_key(sent.key).mission_id)
        return replace(sent, key=key.encode())
