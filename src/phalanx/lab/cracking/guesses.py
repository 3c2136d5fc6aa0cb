"""Brute-force attacks on a captured mission, as generators of batches; the caller limits and times them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

from phalanx.attacks.missions.between import Between, Sent
from phalanx.crypto.sha3 import sha3_256
from phalanx.mission import BuildOptions, Landmark, Mission, Profile, parse_mission, parse_start_key
from phalanx.mission.authoring.compiling import alias_offset, observed_bytes
from phalanx.mission.file.records import SECRET_BYTES
from phalanx.mission.file.sealed import node_salt, try_observation
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.walk.gate import StartKey
from phalanx.mission.worth.audit import audit
from phalanx.mission.worth.guessing import OUT_OF_REACH
from phalanx.mission.worth.shown import PlanCandidates, candidates_in
from phalanx.robot.adversary.attack import Scene

from .force import Box, GuessedNode, TriedBatch, crack_paper, crack_sealed

GATES = 2.0 ** (8 * SECRET_BYTES)
TOKEN_BYTES = 16
TOKENS = 2.0 ** (8 * TOKEN_BYTES)
TOKEN_BATCH = 16


class Guess(Between, ABC):
    """Offline attack that guesses the content of a captured mission file.

    Class attributes:
        tries_max: number of tries after which the attack ends, by profile: fast hashes, or slow ones.
        one_node: whether the attack concerns only the node with the token.
    """

    scene: ClassVar[Scene] = "file"
    tries_max: ClassVar[Mapping[Profile, int]] = {Profile.PAPER: 1 << 30, Profile.SEALED: 64}
    one_node: ClassVar[bool] = False

    @abstractmethod
    def guess(self, sent: Sent, box: Box, building: FloorPlan) -> Iterator[TriedBatch]:
        """Yield batches of tries for as long as the caller asks for more.

        Args:
            box: area of all positions, metres.
            building: for attacks that have the floor plan.
        """

    def in_all(self, plain: Mission, known: int) -> float:
        """Return the number of tries for the whole mission: `known`, or with the nodes that are still sealed."""
        return float(known)


def crack(
    sent: Sent, box: Box, key: StartKey | None = None, plan: PlanCandidates | None = None
) -> Iterator[TriedBatch]:
    """Yield batches of tries of every position, with the start key that was sent or `key`."""
    mission = parse_mission(sent.file)
    if mission.header.profile is Profile.PAPER:
        return crack_paper(mission, box)
    return crack_sealed(mission, key or parse_start_key(sent.key), box, plan=plan)


class GuessGraph(Guess):
    """Guess with the file and its start key, if it has one, captured from the robot."""

    def guess(self, sent: Sent, box: Box, building: FloorPlan) -> Iterator[TriedBatch]:
        return crack(sent, box)

    def in_all(self, plain: Mission, known: int) -> float:
        """Add the candidates of nodes that are still sealed; the author's audit knows their number."""
        if plain.coding is None:  # the paper profile: every node can be tried at once
            return float(known)
        rows = audit(plain, Profile.SEALED, open_start=True).nodes
        return max(float(known), sum(row.candidates for row in rows if row.candidates < OUT_OF_REACH))


class GuessPlan(Guess):
    """Guess with the file, the start key and the building's floor plan, which the adversary has or can survey."""

    def guess(self, sent: Sent, box: Box, building: FloorPlan) -> Iterator[TriedBatch]:
        return crack(sent, box, plan=candidates_in(building, BuildOptions().offset_mm))


class GuessGate(GuessGraph):
    """Guess with the file alone: the start key was sent over the link and is not part of the file."""

    def guess(self, sent: Sent, box: Box, building: FloorPlan) -> Iterator[TriedBatch]:
        if parse_mission(sent.file).header.profile is Profile.PAPER:
            yield from crack(sent, box)
            return
        key = parse_start_key(sent.key)  # its shapes and offsets only; even these the adversary lacks
        while True:
            gates = {
                node: replace(gate, share=self.plan.chance.bytes(SECRET_BYTES)) for node, gate in key.gates.items()
            }
            for batch in crack(sent, box, StartKey(key.mission_id, gates, {})):
                yield replace(batch, of=int(batch.of * GATES))


class GuessToken(Guess):
    """Guess a token of 128 random bits in a code on a wall; the adversary knows its position and has all gates."""

    tries_max: ClassVar[Mapping[Profile, int]] = {Profile.PAPER: 4096, Profile.SEALED: 64}
    one_node = True

    def guess(self, sent: Sent, box: Box, building: FloorPlan) -> Iterator[TriedBatch]:
        mission, node = parse_mission(sent.file), sent.plain.nodes[0]
        header, mark = mission.header, mission.nodes[0].aliases[0].mark
        (place,) = node.see[0]
        assert isinstance(place, Landmark), "the captured node is a code"
        offset = alias_offset(header.coding, node.see[0])
        salt, do, hint = b"", node.do, None
        if header.profile is Profile.SEALED:
            # The action is in the payload, and not part of the observation.
            gate = parse_start_key(sent.key).gates[0]
            salt, do, hint = node_salt(gate.share, (), header, 0, 0), None, gate.hints[0]
        while True:
            found: list[GuessedNode] = []
            for _ in range(TOKEN_BATCH):
                code = replace(place, text=self.plan.chance.bytes(TOKEN_BYTES).hex())
                observed = observed_bytes(header.coding, (code,), offset, do=do)
                if mark == (try_observation(header, observed, hint, salt)[0] if hint else sha3_256(observed)):
                    found.append(GuessedNode(0, place.type, place.x_m, place.y_m, place.orientation_rad))
            yield TriedBatch(TOKEN_BATCH, int(TOKENS), tuple(found))
