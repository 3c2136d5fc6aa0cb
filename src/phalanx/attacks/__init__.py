"""The attacks: what each is (library.py), and who carries it out: the same robot, lying, in one class each."""

from phalanx.robot.adversary.attack import Attack, own_attack

from .library import ATTACKS, IN_FLOCKS, IN_PROTOCOLS, IN_SWARMS, ON_MISSIONS

__all__ = [
    "ATTACKS",
    "IN_FLOCKS",
    "IN_PROTOCOLS",
    "IN_SWARMS",
    "ON_MISSIONS",
    "Attack",
    "own_attack",
]
