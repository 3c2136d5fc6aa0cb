"""Trusted nodes with keys, and why they refuse."""

from __future__ import annotations

from dataclasses import replace

import pytest

from asked_nodes import Nodes
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Refused, seal_mission_key
from phalanx.config import BtiConfig

MASTER, MISSION, R = bytes(range(20)), bytes(range(50, 70)), b"random" * 3 + b"!!"
LIMITS = Limits.of(BtiConfig(), fixed_us=100, ns_per_byte_broadcast=1333, ns_per_byte_unicast=300)


def keyed(profile=trusted.HARDENED, n=3, now=0, **more):
    nodes = Nodes(n, profile, replace(LIMITS, **more))
    for i in range(n):
        nodes.load_master(i, MASTER, i + 1)
        nodes.load_mission(i, now, seal_mission_key(MASTER, MISSION, R, 1))
    return nodes


def refusal(action, *arguments):
    with pytest.raises(Refused) as refused:
        action(*arguments)
    return refused.value.reason
