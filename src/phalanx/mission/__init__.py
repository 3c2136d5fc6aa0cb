"""Encoded missions: a robot decodes a step of its task only when it observes the right thing in the right place.

Write a mission as a `Draft` or in YAML (`plain_mission`) and `build` it. On the robot, check it with `check_signature`
and `admit`, then execute it: `Walker.step(state, experience)` returns the next state and an `Outcome`.
"""

from .authoring.compiling import BuildOptions, Built, build
from .authoring.document import plain_mission
from .file.canonical import canonical
from .file.records import EncodedMission, Profile, admit, check_signature, parse_mission, public_key, sign
from .graph import Draft, Mission, Node
from .observable import (
    LANDMARK_TYPES,
    Action,
    Direction,
    Experience,
    Landmark,
    Message,
    Observable,
    Position,
    Previous,
    Sensor,
    Time,
)
from .walk.claims import Claim
from .walk.gate import StartKey, parse_start_key
from .walk.opening import Opened, OpenWay
from .walk.state import Kind, Order, Outcome, Phase, Reason
from .walk.walker import State, Walker

__all__ = [
    "LANDMARK_TYPES",
    "Action",
    "BuildOptions",
    "Built",
    "Claim",
    "Direction",
    "Draft",
    "EncodedMission",
    "Experience",
    "Kind",
    "Landmark",
    "Message",
    "Mission",
    "Node",
    "Observable",
    "OpenWay",
    "Opened",
    "Order",
    "Outcome",
    "Phase",
    "Position",
    "Previous",
    "Profile",
    "Reason",
    "Sensor",
    "StartKey",
    "State",
    "Time",
    "Walker",
    "admit",
    "build",
    "canonical",
    "check_signature",
    "parse_mission",
    "parse_start_key",
    "plain_mission",
    "public_key",
    "sign",
]
