"""A world of arrays and ticks, and the door to it: `simulate` runs a scenario, and gives arrays.

What is imported from here is loaded when it is first used: whoever only names scenarios does not wait for numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .scenarios.file import find_scenario
    from .scenarios.result import Result
    from .scenarios.scenario import AttackSpec, Scenario
    from .scenarios.simulate import simulate
    from .swarms.dotbots import Dotbots

__all__ = ["AttackSpec", "Dotbots", "Result", "Scenario", "find_scenario", "simulate"]

_FOUND_IN = {
    "AttackSpec": "scenarios.scenario",
    "Dotbots": "swarms.dotbots",
    "Result": "scenarios.result",
    "Scenario": "scenarios.scenario",
    "find_scenario": "scenarios.file",
    "simulate": "scenarios.simulate",
}


def __getattr__(name: str) -> Any:
    if name in _FOUND_IN:
        return getattr(import_module(f"{__name__}.{_FOUND_IN[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
