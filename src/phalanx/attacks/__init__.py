"""Attacks on the shields: a table of all of them (library.py), and one class for the compromised robot of each."""

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
