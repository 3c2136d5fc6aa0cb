"""An attack against a defence, beside the same without it: what every trial says, wherever it was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from phalanx.config.defence import Defence
from phalanx.robot.attacks.attack import Attack


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What an attack came to."""

    attack: str
    defence: str
    declared: str  # what the attack says that this defence makes of it
    harm: float | None  # what the attack measures of its damage, in `harm_unit`; None if nobody is left to be harmed
    harm_unit: str
    harm_words: str
    harm_bites_from: float  # from so much on, the attack calls it a bite
    attacked: Any  # what became of those that were attacked, and of the same that nobody attacks
    honest: Any


def said_of(attack: Attack, defence: Defence) -> dict[str, Any]:
    """What every trial of this attack says, less what came of it."""
    return {
        "attack": attack.name,
        "defence": defence,
        "declared": attack.verdicts[defence],
        "harm_unit": attack.harm.unit,
        "harm_words": attack.harm.words,
        "harm_bites_from": attack.bites_from,
    }
