"""The slow search of the sealed profile: a few tries of scrypt, the likeliest first, none of them twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.file import sealed
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import Cell, Experience, Landmark, middle_of
from phalanx.mission.pose.spread import misfit

from .fix import fits, is_there, sighting
from .found import Claim, Found
from .gate import Hint
from .search import Budget, Variant, cells_around, doubt_in, placed


@dataclass(frozen=True, slots=True)
class Candidate:
    """One alias of a sealed node whose gate the robot holds."""

    node: int
    alias: int
    gate: bytes
    hint: Hint


def search_sealed(
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
    tried: frozenset[bytes],
    newly_tried: set[bytes],
    budget: Budget,
) -> Iterator[Found]:
    """Matches in the sealed profile: a few slow tries, the likeliest first, none of them twice.

    Args:
        candidates: whose gates are held, the likeliest first.
        tried: digests of (gate, observation) that failed in earlier steps.
        newly_tried: gets those that fail now.
        budget: is spent; what is left over comes in the next step, if it is still there to be seen.
    """
    header = mission.header
    # What is nearest to its estimate comes first, whichever candidate it is of.
    jobs = sorted(_jobs(mission, config, candidates, seen, heard), key=lambda job: job[0])
    for _, candidate, variant, cell in jobs:
        shape = candidate.hint.shape
        salt = sealed.node_salt(candidate.gate, variant.messages, header, candidate.node, candidate.alias)
        observed = variant.canonical(shape, cell)
        name = sha3_256(salt + observed)
        if name in tried or name in newly_tried:
            continue
        if budget.left <= 0:
            return
        budget.spend(1)
        mark, key = sealed.try_observation(header, observed, candidate.hint, salt)
        if mark == mission.nodes[candidate.node].aliases[candidate.alias].mark:
            where = (candidate.node, candidate.alias, shape, candidate.hint.offset, cell)
            yield Found(Claim(*where, observed, salt), variant.landmark, variant.action, key)
        else:
            newly_tried.add(name)


def _jobs(
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
) -> Iterator[tuple[float, Candidate, Variant, Cell]]:
    """(misfit, candidate, what is tried, in which cell): what was encoded lies in the middle of its cell."""
    coding, doubt = mission.header.coding, doubt_in(config, seen)
    for candidate in candidates:
        shape, offset = candidate.hint.shape, candidate.hint.offset
        reach_dm = mission.nodes[candidate.node].reach_dm
        for variant, centre in placed(shape, coding, seen, heard, offset, reach_dm):
            for cell in cells_around(shape, coding, doubt, variant.landmark, centre, offset):
                x, y, turn = middle_of(coding, offset, cell)
                if variant.landmark is None:
                    if not shape.place or is_there(config, seen, x, y):
                        yield float(abs(cell.x - centre.x) + abs(cell.y - centre.y)), candidate, variant, cell
                    continue
                truth = Landmark(variant.landmark.type, x, y, turn)
                match = sighting(variant.landmark, truth, variant.landmark.x_m, variant.landmark.y_m)
                if fits(config, doubt.spread, seen.x_m, seen.y_m, match):
                    yield misfit(doubt.spread, seen.x_m, seen.y_m, match, doubt.sight), candidate, variant, cell
