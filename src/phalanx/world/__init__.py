"""Array-based simulator of robot swarms; `simulate` runs a scenario and returns arrays.

Names are imported on first use, so that reading scenarios does not load the simulator.
"""

from typing import TYPE_CHECKING

from phalanx.loading import loaded_when_used

if TYPE_CHECKING:
    from phalanx.scenarios.attack_spec import AttackSpec
    from phalanx.scenarios.file import find_scenario
    from phalanx.scenarios.scenario import Scenario

    from .scenarios.result import Result
    from .scenarios.simulate import simulate
    from .swarms.dotbots import Dotbots

__all__ = ["AttackSpec", "Dotbots", "Result", "Scenario", "find_scenario", "simulate"]

_FOUND_IN = {
    "AttackSpec": ".scenarios.attack_spec",
    "Dotbots": "swarms.dotbots",
    "Result": "scenarios.result",
    "Scenario": ".scenarios.scenario",
    "find_scenario": ".scenarios.file",
    "simulate": "scenarios.simulate",
}

__getattr__ = loaded_when_used(__name__, _FOUND_IN)


def __dir__() -> list[str]:
    return __all__
