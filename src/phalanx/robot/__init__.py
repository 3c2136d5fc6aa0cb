"""What a robot is to those who command it, and what controllers and attacks of your own are made of.

The latter are loaded when they are first used: whoever only has a swarm does not wait for numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .swarm import Led, Point, Robot, Swarm

if TYPE_CHECKING:
    from .attacks.attack import Attack, own_attack
    from .attacks.liar import Liar
    from .controllers.python_controller import Act, Controller, Send

__all__ = ["Act", "Attack", "Controller", "Led", "Liar", "Point", "Robot", "Send", "Swarm", "own_attack"]

_FOUND_IN = {
    "Act": "controllers.python_controller",
    "Attack": "attacks.attack",
    "Controller": "controllers.python_controller",
    "Liar": "attacks.liar",
    "Send": "controllers.python_controller",
    "own_attack": "attacks.attack",
}


def __getattr__(name: str) -> Any:
    if name in _FOUND_IN:
        return getattr(import_module(f"{__name__}.{_FOUND_IN[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
