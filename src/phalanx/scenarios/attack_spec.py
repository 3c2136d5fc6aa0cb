"""An attack in a scenario: which robot lies, how, and when; and its short form, `spoof:robot=7,at=15`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from phalanx.config.parameter import check_limits, described, description, within
from phalanx.errors import UsageError
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.registry import attacks

LONGEST_S = 7 * 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AttackSpec:
    """An attack on a robot and when it lies. Raises: UsageError: a value is out of range. Source: RoboRebound §5.3."""

    name: str = field(metadata=description("of one of the attacks that phalanx attack list names"))
    robot: int | None = described(None, "id of who is compromised; None: the seed chooses")
    at_s: float = within(15.0, 0.0, LONGEST_S, "when it begins to lie")
    until_s: float | None = described(None, "when it is honest again; None for never")
    options: Mapping[str, float | str] = field(
        default_factory=dict, hash=False, metadata=description("the attack's own, by name")
    )
    own: Attack | None = field(default=None, hash=False)  # an attack that is not in the library, whatever `name` says

    @property
    def attack(self) -> Attack:
        """Return the attack's record."""
        return self.own or attacks()[self.name]

    def __post_init__(self) -> None:
        check_limits(self)
        if self.until_s is not None and not self.at_s < self.until_s < math.inf:
            raise UsageError(f"until_s is {self.until_s:g}", f"later than {self.at_s:g}, when {self.name} begins")
        if self.own or self.name in attacks():  # for others a scenario has words of its own
            self.attack.check(self.options)


def parse_attack(words: str, own: Attack | None = None) -> AttackSpec:
    """Return the attack of `NAME[:robot=I,at=T,until=T,OPTION=VALUE,…]`. Raises: UsageError: it is not of that form.

    Times are in seconds. `own` is the attack, if it is not in the library.
    """
    name, colon, rest = words.partition(":")
    hint = "NAME[:robot=I,at=T,until=T,OPTION=VALUE,…], for example spoof:robot=7,at=15"
    if not name or (colon and not rest):
        raise UsageError(f"{words!r} is not an attack", hint)
    said: dict[str, float | str] = {}
    for part in rest.split(",") if rest else ():
        key, equals, value = part.partition("=")
        if not (key and equals and value):
            raise UsageError(f"{part!r} in {words!r} is not OPTION=VALUE", hint)
        if key in said:
            raise UsageError(f"{key} twice in {words!r}", hint)
        said[key] = _number(value)
    try:
        for key in ("at", "until"):
            if isinstance(said.get(key), str):
                raise UsageError(f"{key} of {name} is {said[key]!r}", "seconds")
        robot = said.pop("robot", None)
        if robot is not None and (isinstance(robot, str) or robot != int(robot)):
            raise UsageError(f"robot of {name} is {robot!r}", "a robot's id, a whole number")
        return AttackSpec(
            name=name,
            robot=None if robot is None else int(robot),
            at_s=float(said.pop("at", 15.0)),
            until_s=float(said.pop("until")) if "until" in said else None,
            options=said,
            own=own,
        )
    except UsageError as error:
        raise UsageError(f"{words!r}: {error}", error.hint) from error


def _number(words: str) -> float | str:
    try:
        value = float(words)
    except ValueError:
        return words
    return value if math.isfinite(value) else words
