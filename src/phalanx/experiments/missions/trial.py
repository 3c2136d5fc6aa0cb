"""One attack on a mission against one defence, beside the same errand without it; and whether the verdict is borne out.

The defences: a robot with `none` follows the same mission as a plain graph, and believes what it senses. With `paper`
it has the paper profile, unsigned, and runs whatever it gets. With `bound`, ours, the mission is sealed, signed, bound
to this robot and to a window of time, and started once.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

from phalanx.config.defence import Defence
from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError
from phalanx.experiments.trial import Trial, said_of
from phalanx.mission import parse_mission
from phalanx.robot.attacks.attack import Attack, Verdict
from phalanx.robot.attacks.harm import FALSE_FIX_M, Guessed, Walked
from phalanx.robot.attacks.missions.guesses import Guess

from .attacked import ROBOT, Operator, honest_errand, plan_of, walk
from .errand import AREA_M, building, errand, shelf_alone

LATEST_S = 3600.0
SEALED = CodingConfig(delta_mm=400)
OUT_OF_REACH = 2.0**100  # tries that nobody makes


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionTrial(Trial):
    """What an attack on a mission came to.

    `attacked` is what became of the robot (`Walked`), or of the mission that was guessed (`Guessed`); `honest`, of the
    robot that nobody attacks, None where a mission was guessed or nothing was ordered.
    """

    against: str  # what it lies about
    kept: bool  # whether the declared verdict is what was seen

    @property
    def broken(self) -> bool:
        """Whether something that is promised was not kept."""
        return not self.kept


def try_mission_attack(
    attack: Attack, defence: Defence, seed: int = 0, options: Mapping[str, float | str] | None = None
) -> MissionTrial:
    """An attack on an errand or on a captured file, run, and measured by the world's truth.

    Options: `at`, when it begins to lie, s; `bit`, which one `flip-bit` changes; `unchecked`, 1 for a robot of ours
    that looks at no signature, name or window.

    Raises: UsageError: no such option, or a number that is none for it.
    """
    kind, said = attack.kind, dict(options or {})
    attack.check(said)
    start_s = float(said.get("at", kind.starts_s))
    if seed < 0 or not 0 <= start_s <= LATEST_S:
        raise UsageError(
            f"{attack.name} at {start_s:g} s, seed {seed}", f"0 to {LATEST_S:g} s, and a seed of 0 or more"
        )
    made = kind(plan_of(defence, seed, start_s, said))
    honest: Walked | None = None
    attacked: Walked | Guessed
    if isinstance(made, Guess):
        attacked = try_guess(made, defence, seed)
    else:
        today = Operator(defence, seed).send(errand(), ROBOT, 1)
        attacked = walk(made, today, defence, seed, checked=not said.get("unchecked"))
        if kind.ordered:
            honest = honest_errand(defence, seed, released=kind.released)
    harm = attack.harm.of(attacked)
    return MissionTrial(
        **said_of(attack, defence),
        against=attack.against,
        kept=is_kept(attack.verdicts[defence], attack, attacked, harm),
        harm=harm,
        attacked=attacked,
        honest=honest,
    )


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
    read: set[int] = set()
    made, of = 0, 0
    began = time.perf_counter()
    for batch in attack.guess(sent, AREA_M, building()):
        made, of = made + batch.tries, batch.of
        read |= {found.node for found in batch.found}
        if made >= most:
            break
    seconds = time.perf_counter() - began
    rate = made / seconds
    whole = attack.in_all(plain, of)
    return Guessed(nodes, len(read), made, seconds, rate, whole, whole / rate)


def is_kept(declared: Verdict, attack: Attack, attacked: Walked | Guessed, harm: float) -> bool:
    """Whether a declared verdict is what was seen, with this harm. Source: docs/attacks.md (what the verdicts mean)."""
    if declared in ("bites", "not covered"):
        return harm >= attack.bites_from
    if isinstance(attacked, Guessed):
        return harm == 0 and (attacked.candidates >= OUT_OF_REACH) == (declared == "harmless")
    if attacked.wrong_actions or attacked.false_nodes:
        return False
    if declared == "stopped":
        gave_a_reason = bool(attacked.refused or attacked.not_validated)
        return attacked.held and gave_a_reason and not attacked.done and attacked.worst_fix_m <= FALSE_FIX_M
    if declared == "limited":
        return harm <= attack.limit
    return attacked.done and harm < attack.bites_from
