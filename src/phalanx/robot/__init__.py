"""The operator's interface to robots, and base classes for your own controllers, planners and attacks.

The base classes are imported on first use, so that importing a swarm stays fast.
"""

from typing import TYPE_CHECKING

from phalanx.loading import loaded_when_used

from .swarm import Led, Point, Robot, Swarm

if TYPE_CHECKING:
    from phalanx.wire.typed_records import Command, Reading, State
    from phalanx.wire.widths import F32, F64, I8, I16, I32, I64, U8, U16, U32, U64

    from .actions import Action
    from .adversary.attack import Attack, own_attack
    from .adversary.liar import Liar
    from .controllers.python_controller import Act, Controller, Send
    from .controllers.senses import Senses
    from .planner import Planner

__all__ = [
    "F32",
    "F64",
    "I8",
    "I16",
    "I32",
    "I64",
    "U8",
    "U16",
    "U32",
    "U64",
    "Act",
    "Action",
    "Attack",
    "Command",
    "Controller",
    "Led",
    "Liar",
    "Planner",
    "Point",
    "Reading",
    "Robot",
    "Send",
    "Senses",
    "State",
    "Swarm",
    "own_attack",
]

_FOUND_IN = {
    "Action": "actions",
    "Act": "controllers.python_controller",
    "Attack": "adversary.attack",
    "Controller": "controllers.python_controller",
    "Liar": "adversary.liar",
    "Planner": "planner",
    "Send": "controllers.python_controller",
    "Senses": "controllers.senses",
    "own_attack": "adversary.attack",
    **dict.fromkeys(("Command", "Reading", "State"), ".wire.typed_records"),
    **dict.fromkeys("F32 F64 I8 I16 I32 I64 U8 U16 U32 U64".split(), ".wire.widths"),
}

__getattr__ = loaded_when_used(__name__, _FOUND_IN)


def __dir__() -> list[str]:
    return __all__
