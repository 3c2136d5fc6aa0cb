"""The brute force of a captured mission, run for as many tries as a person waits for, and extrapolated at its rate."""

from __future__ import annotations

import time

from phalanx.config.defence import Defence
from phalanx.config.mission import CodingConfig
from phalanx.mission import Profile, parse_mission
from phalanx.robot.attacks.missions.guesses import Guess
from phalanx.robot.attacks.missions.harm import Guessed

from .attacked import ROBOT, Operator
from .errand import AREA_M, errand, shelf_alone

SEALED = CodingConfig(delta_mm=400)


def try_guess(
    attack: Guess, defence: Defence, seed: int, *, coding: CodingConfig | None = None, tries: int | None = None
) -> Guessed:
    """What came of guessing, on one core, with at most about so many tries; by default as many as the attack has.

    The mission was captured in the form that `defence` has, in a `coding` that costs what robots' does unless given.
    """
    coding = coding or (SEALED if defence == "bound" else None)
    plain = shelf_alone(coding) if attack.one_node else errand(coding)
    sent = Operator(defence, seed).send(plain, ROBOT, 1)
    nodes = len(plain.nodes)
    if defence == "none":
        return Guessed(nodes, nodes, 0, 0.0, 0.0, 0.0, 0.0)
    profile = parse_mission(sent.file).header.profile
    most = attack.tries_max[profile] if tries is None else tries
    if profile is Profile.PAPER:
        next(attack.guess(sent, AREA_M))  # compiles what hashes, before the clock runs
    read: set[int] = set()
    made, of = 0, 0
    began = time.perf_counter()
    for batch in attack.guess(sent, AREA_M):
        made, of = made + batch.tries, batch.of
        read |= {found.node for found in batch.found}
        if made >= most:
            break
    seconds = time.perf_counter() - began
    rate = made / seconds
    whole = attack.in_all(plain, of)
    return Guessed(nodes, len(read), made, seconds, rate, whole, whole / rate)
