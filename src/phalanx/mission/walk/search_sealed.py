"""The slow search of the sealed profile: a few tries of scrypt, the likeliest first, none of them twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.file import sealed
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import Experience

from .found import Claim, Found
from .gate import Hint
from .search import LANDMARK_PLACES, Budget, placed, rings_of, spiral


@dataclass(frozen=True, slots=True)
class Candidate:
    """One alias of a sealed node whose gate the robot holds."""

    node: int
    alias: int
    gate: bytes
    hint: Hint


def search_sealed(  # noqa: C901  # one nest of loops, in the order of likelihood
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
    turns: tuple[float, ...],
    tried: frozenset[bytes],
    newly_tried: set[bytes],
    budget: Budget,
) -> Iterator[Found]:
    """Matches in the sealed profile: a few slow tries, the likeliest first, none of them twice.

    Args:
        candidates: whose gates are held, the likeliest first.
        turns: of the heading, in the order to try them; 0 first.
        tried: digests of (gate, observation) that failed in earlier steps.
        newly_tried: gets those that fail now.
        budget: is spent; what is left over comes in the next step, if it is still there to be seen.
    """
    header = mission.header
    coding = header.coding
    rings = rings_of(config, coding, 1 << 20)
    for turn in turns:
        jobs = []
        for candidate in candidates:
            shape = candidate.hint.shape
            if turn and shape.place not in LANDMARK_PLACES:
                continue
            reach_dm = mission.nodes[candidate.node].reach_dm
            for variant, centre in placed(shape, coding, seen, heard, candidate.hint.offset, reach_dm, turn):
                salt = sealed.node_salt(candidate.gate, variant.messages, header, candidate.node, candidate.alias)
                jobs.append((candidate, variant, centre, salt))
        # Ring by ring over all of them: what is near its estimate is far likelier than what is not.
        for k, (dx, dy) in enumerate(spiral(rings)):
            for candidate, variant, centre, salt in jobs:
                shape = candidate.hint.shape
                # Cells of 0.4 m and bins of 15 degrees forgive what a turn would mend elsewhere.
                if k and (turn or not shape.place):
                    continue
                cell = centre._replace(x=centre.x + dx, y=centre.y + dy)
                observed = variant.canonical(shape, cell)
                name = sha3_256(salt + observed)[:16]
                if name in tried or name in newly_tried:
                    continue
                if budget.left <= 0:
                    return
                budget.spend(1)
                mark, key = sealed.try_observation(header, observed, candidate.hint, salt)
                if mark == mission.nodes[candidate.node].aliases[candidate.alias].mark:
                    where = (candidate.node, candidate.alias, shape, candidate.hint.offset, cell)
                    yield Found(Claim(*where, observed, salt, turn), variant.landmark, variant.action, key)
                else:
                    newly_tried.add(name)
