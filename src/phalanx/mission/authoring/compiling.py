"""A plain mission becomes an encoded one. Random bytes are an argument; the slow step can be spread over threads."""

from __future__ import annotations

from phalanx.mission.file.records import Profile
from phalanx.mission.graph import Mission

from .apart import told_apart
from .making import BuildOptions, Built, Random, Spread
from .making_paper import PaperMaker
from .making_sealed import SealedMaker


def build(
    mission: Mission,
    options: BuildOptions,
    random: Random,
    spread: Spread = map,
) -> list[Built]:
    """The encoded mission: one file for every part.

    Args:
        random: so many unpredictable bytes.
        spread: like `map`; a thread pool's, to try several slow hashes at once.
    Raises: UsageError: the mission cannot be said in this profile.
    Source: Encoded graphs §III, §IV-A; docs/spec/mission.md.
    """
    maker = (PaperMaker if options.profile is Profile.PAPER else SealedMaker)(told_apart(mission), options, random)
    return [maker.part(part, spread) for part in mission.parts]
