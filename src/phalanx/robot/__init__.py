"""What a robot is to those who command it, and what controllers and attacks of your own are made of.

The latter are loaded when they are first used: whoever only has a swarm does not wait for them.
"""

from typing import TYPE_CHECKING

from phalanx.loading import loaded_when_used

from .swarm import Led, Point, Robot, Swarm

if TYPE_CHECKING:
    from .attacks.attack import Attack, own_attack
    from .attacks.liar import Liar
    from .controllers.python_controller import Act, Controller, Send
    from .controllers.senses import Senses
    from .planner import Planner

__all__ = [
    "Act",
    "Attack",
    "Controller",
    "Led",
    "Liar",
    "Planner",
    "Point",
    "Robot",
    "Send",
    "Senses",
    "Swarm",
    "own_attack",
]

_FOUND_IN = {
    "Act": "controllers.python_controller",
    "Attack": "attacks.attack",
    "Controller": "controllers.python_controller",
    "Liar": "attacks.liar",
    "Planner": "planner",
    "Send": "controllers.python_controller",
    "Senses": "controllers.senses",
    "own_attack": "attacks.attack",
}

__getattr__ = loaded_when_used(__name__, _FOUND_IN)


def __dir__() -> list[str]:
    return __all__
