"""The slow search of the sealed profile: a few tries of scrypt, the likeliest first, none of them twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import canonical, place_bytes
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import Cell, Experience

from .gate import Hint
from .search import LANDMARK_PLACES, Budget, Found, as_seen, cell_seen, distance_m, rings_of, spiral, variants


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
            for variant in variants(shape, coding, seen, heard):
                landmark = variant.landmark and as_seen(variant.landmark, seen, turn)
                if landmark and reach_dm and distance_m(seen, landmark) * 10 > reach_dm:
                    continue
                centre = cell_seen(shape, coding, candidate.hint.offset, seen, landmark) if shape.place else Cell(0, 0)
                salt = sealed.node_salt(candidate.gate, variant.messages, header, candidate.node, candidate.alias)
                jobs.append((candidate, variant, landmark, centre, salt))
        # Ring by ring over all of them: what is near its estimate is far likelier than what is not.
        for k, (dx, dy) in enumerate(spiral(rings)):
            for candidate, variant, landmark, centre, salt in jobs:
                shape = candidate.hint.shape
                # Cells of 0.4 m and bins of 15 degrees forgive what a turn would mend elsewhere.
                if k and (turn or not shape.place):
                    continue
                cell = centre._replace(x=centre.x + dx, y=centre.y + dy)
                observed = canonical(
                    place_bytes(shape, cell, landmark.text if landmark else None),
                    sensors=variant.sensors,
                    action=variant.action,
                    window=variant.window,
                )
                name = sha3_256(salt + observed)[:16]
                if name in tried or name in newly_tried:
                    continue
                if budget.left <= 0:
                    return
                budget.spend(1)
                mark, key = sealed.try_observation(header, observed, candidate.hint, salt)
                if mark == mission.nodes[candidate.node].aliases[candidate.alias].mark:
                    offset = candidate.hint.offset
                    yield Found(
                        candidate.node,
                        candidate.alias,
                        shape,
                        cell,
                        offset,
                        variant.landmark,
                        variant.action,
                        turn,
                        observed,
                        salt,
                        key,
                    )
                else:
                    newly_tried.add(name)
