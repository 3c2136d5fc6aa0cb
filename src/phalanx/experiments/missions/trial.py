"""One attack on a mission against one defence, beside the same errand without it; and whether the verdict is borne out.

The defences: `none` is a robot that follows the same mission as a plain graph and believes what it senses; `paper` is
one with the paper profile, unsigned, which runs whatever it gets; `bound` is ours: sealed, signed, bound to this robot
and to a window of time, and started once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from phalanx.errors import UsageError
from phalanx.robot.attacks.attack import Defence, Verdict
from phalanx.robot.attacks.missions import MISSION_ATTACKS, Guess, Guessed, MissionAttack, Walked
from phalanx.sim.missions.robot import FALSE_FIX_M

from .attacked import ROBOT, Operator, honest_errand, plan_of, walk
from .errand import errand
from .guess import try_guess

LATEST_S = 3600.0
OUT_OF_REACH = 2.0**100  # tries that nobody makes


@dataclass(frozen=True, slots=True)
class MissionTrial:
    """What an attack on a mission came to.

    Args:
        attack, against, defence: as named.
        declared: what the attack says that this defence makes of it.
        kept: whether that is what was seen.
        harm: what the attack measures of its damage, in `harm_unit`.
        harm_words: what is measured.
        harm_bites_from: from so much on, the attack calls it a bite.
        attacked: what became of the robot, or of the mission that was guessed.
        honest: of the robot that nobody attacks; None where a mission was guessed, or nothing was ordered.
    """

    attack: str
    against: str
    defence: str
    declared: Verdict
    kept: bool
    harm: float
    harm_unit: str
    harm_words: str
    harm_bites_from: float
    attacked: Walked | Guessed
    honest: Walked | None


def try_mission_attack(
    name: str, defence: Defence, seed: int = 0, options: Mapping[str, float | str] | None = None
) -> MissionTrial:
    """An attack on a mission, run, and measured by the world's truth.

    Args:
        name: of the attack.
        defence: of the robot, or of the captured file.
        seed: of all that is drawn.
        options: `at`, when it begins to lie, s; `bit`, which one `flip-bit` changes; `unchecked`, 1 for a robot of ours
            that looks at no signature, name or window.
    Raises: UsageError: no such attack or option, or a number that is none for it.
    """
    if name not in MISSION_ATTACKS:
        raise UsageError(f"no attack {name!r} on missions", f"one of {', '.join(sorted(MISSION_ATTACKS))}")
    kind, said = MISSION_ATTACKS[name], dict(options or {})
    if wrong := [f"{key}={value}" for key, value in said.items() if key not in kind.takes or isinstance(value, str)]:
        raise UsageError(
            f"{name} with {', '.join(wrong)}", f"its options are numbers: {', '.join(kind.takes) or 'none'}"
        )
    start_s = float(said.get("at", kind.starts_s))
    if seed < 0 or not 0 <= start_s <= LATEST_S:
        raise UsageError(f"{name} at {start_s:g} s, seed {seed}", f"0 to {LATEST_S:g} s, and a seed of 0 or more")
    attack = kind(plan_of(defence, seed, start_s, said))
    honest: Walked | None = None
    attacked: Walked | Guessed
    if isinstance(attack, Guess):
        attacked = try_guess(attack, defence, seed)
    else:
        today = Operator(defence, seed).send(errand(), ROBOT, 1)
        attacked = walk(attack, today, defence, seed, checked=not said.get("unchecked"))
        if kind.ordered:
            honest = honest_errand(defence, seed, released=kind.released)
    harm = kind.harm.of(attacked)
    declared = kind.verdicts[defence]
    return MissionTrial(
        attack=name,
        against=kind.against,
        defence=defence,
        declared=declared,
        kept=is_kept(declared, kind, attacked, harm),
        harm=harm,
        harm_unit=kind.harm.unit,
        harm_words=kind.harm.words,
        harm_bites_from=kind.bites_from,
        attacked=attacked,
        honest=honest,
    )


def is_kept(declared: Verdict, kind: type[MissionAttack], attacked: Walked | Guessed, harm: float) -> bool:
    """Whether a verdict is what was seen.

    Args:
        declared: the verdict.
        kind: of the attack.
        attacked: what was seen.
        harm: of it, in the attack's own measure.
    Source: docs/attacks.md (what the verdicts mean).
    """
    if declared in ("bites", "not covered"):
        return harm >= kind.bites_from
    if isinstance(attacked, Guessed):
        return harm == 0 and (attacked.candidates >= OUT_OF_REACH) == (declared == "harmless")
    if attacked.wrong_actions or attacked.false_nodes:
        return False
    if declared == "stopped":
        gave_a_reason = bool(attacked.refused or attacked.not_validated)
        return attacked.held and gave_a_reason and not attacked.done and attacked.worst_fix_m <= FALSE_FIX_M
    if declared == "limited":
        return harm <= kind.limit
    return attacked.done and harm < kind.bites_from
