"""What can be asked of an attack beside robot, at and until: checked before any robot lies."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from phalanx.errors import UsageError

if TYPE_CHECKING:
    from .attack import Attack, Defence


@dataclass(frozen=True, slots=True)
class Option:
    """One thing that can be asked.

    Args:
        values: what it may be.
        defences: under which it makes a difference.
    """

    values: tuple[float | str, ...]
    defences: tuple[Defence, ...] = ("none", "paper", "bound")


def check_options(kind: type[Attack], options: Mapping[str, float | str]) -> None:
    """All that is asked of the attack is something that it does.

    Raises: UsageError: it has no such option, or not with that value.
    """
    for name, value in options.items():
        if name not in kind.options:
            near = difflib.get_close_matches(name, kind.options, 1, 0.5)
            guess = f"did you mean {near[0]}? " if near else ""
            allowed = ", ".join((*kind.options, "robot", "at", "until"))
            raise UsageError(f"options of {kind.name} have no {name!r}", f"{guess}it takes {allowed}")
        if value not in kind.options[name].values:
            shown = f"{value:g}" if isinstance(value, float) else repr(value)
            allowed = " or ".join(str(each) for each in kind.options[name].values)
            raise UsageError(f"options of {kind.name} have {name}={shown}", f"{name} is {allowed}")


def idle_options(kind: type[Attack], options: Mapping[str, float | str], defence: Defence) -> list[str]:
    """Those that make no difference under the defence, by name."""
    return [name for name in options if defence not in kind.options[name].defences]
