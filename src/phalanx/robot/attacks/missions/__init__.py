"""Attacks on missions: an honest robot, and a world or a courier that lies to it. One class each."""

from .attack import MissionAttack, MissionPlan, Sent
from .body import DeadWheel, Slip
from .files import FlipBit, ForgeGraph, ReplayAgain, ReplayDay, ReplayRobot, SetClock, SwapKey
from .guesses import Guess, GuessGate, GuessGraph, GuessToken
from .harm import Guessed, Walked
from .messages import DrownMessage, StaleMessage
from .senses import DragScan, FreezeScan, SpoofScan
from .unprotected import PlainWalker
from .walls import CloneCode, MoveCode, NudgeCode

MISSION_ATTACKS: dict[str, type[MissionAttack]] = {
    attack.name: attack
    for attack in (
        # The file and its key.
        FlipBit, ForgeGraph, ReplayDay, ReplayRobot, ReplayAgain, SetClock, SwapKey,
        # What the robot senses and hears.
        SpoofScan, DragScan, FreezeScan, MoveCode, CloneCode, NudgeCode, StaleMessage, DrownMessage,
        # What its body does.
        DeadWheel, Slip,
        # What can be read of a captured file.
        GuessGraph, GuessGate, GuessToken,
    )
}  # fmt: skip

__all__ = [
    "MISSION_ATTACKS",
    "Guess",
    "Guessed",
    "MissionAttack",
    "MissionPlan",
    "PlainWalker",
    "Sent",
    "Walked",
]
