"""An attack in a scenario: which robot is compromised, how, and when; and its short form, `spoof:robot=7,at=15`."""

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
    """An attack, the robot it compromises, and its times.

    Raises: UsageError: a value is out of range. Source: RoboRebound §5.3.
    """

    name: str = field(metadata=description("name of an attack, as listed by phalanx attack list"))
    robot: int | None = described(None, "id of the compromised robot; None: the seed chooses")
    at_s: float = within(15.0, 0.0, LONGEST_S, "start of the attack")
    until_s: float | None = described(None, "end of the attack; None for never")
    options: Mapping[str, float | str] = field(
        default_factory=dict, hash=False, metadata=description("options of the attack, by name")
    )
    own: Attack | None = field(default=None, hash=False)  # a user's attack; takes precedence over `name`

    @property
    def attack(self) -> Attack:
        """Return the user's own attack, or the one from the registry."""
        return self.own or attacks()[self.name]

    def __post_init__(self) -> None:
        check_limits(self)
        if self.until_s is not None and not self.at_s < self.until_s < math.inf:
            hint = f"use a time after {self.at_s:g} s, the start of {self.name}"
            raise UsageError(f"until_s is {self.until_s:g}", hint)
        if self.own or self.name in attacks():  # Scenario reports unknown names
            self.attack.check(self.options)


def parse_attack(words: str, own: Attack | None = None) -> AttackSpec:
    """Parse `NAME[:robot=I,at=T,until=T,OPTION=VALUE,…]`. Raises: UsageError: not of that form, or a bad value.

    Times are in seconds. `own` is the attack if it is not in the registry.
    """
    name, colon, rest = words.partition(":")
    hint = "NAME[:robot=I,at=T,until=T,OPTION=VALUE,…], for example spoof:robot=7,at=15"
    if not name or (colon and not rest):
        raise UsageError(f"{words!r} is not an attack", hint)
    options: dict[str, float | str] = {}
    for part in rest.split(",") if rest else ():
        key, equals, value = part.partition("=")
        if not (key and equals and value):
            raise UsageError(f"{part!r} in {words!r} is not OPTION=VALUE", hint)
        if key in options:
            raise UsageError(f"{key} twice in {words!r}", hint)
        options[key] = _number(value)
    try:
        for key in ("at", "until"):
            if isinstance(options.get(key), str):
                raise UsageError(f"{key} of {name} is {options[key]!r}", "use a number of seconds")
        robot = options.pop("robot", None)
        if robot is not None and (isinstance(robot, str) or robot != int(robot)):
            raise UsageError(f"robot of {name} is {robot!r}", "use a robot's id, a whole number")
        return AttackSpec(
            name=name,
            robot=None if robot is None else int(robot),
            at_s=float(options.pop("at", 15.0)),
            until_s=float(options.pop("until")) if "until" in options else None,
            options=options,
            own=own,
        )
    except UsageError as error:
        raise UsageError(f"{words!r}: {error}", error.hint) from error


def _number(text: str) -> float | str:
    try:
        value = float(text)
    except ValueError:
        return text
    return value if math.isfinite(value) else text
