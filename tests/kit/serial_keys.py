"""Keys and limits of trusted nodes behind a serial line."""

from __future__ import annotations

from dataclasses import replace

from phalanx.bti.nodes import seal_mission_key
from small_limits import LIMITS as ORACLE

MASTER, MISSION = bytes(range(20)), bytes(range(7, 27))
# Tokens that no test outlives.
LIMITS = replace(ORACLE, t_val_ms=60_000)


def sealed(seq):
    return seal_mission_key(MASTER, MISSION, bytes([seq]) * 20, seq)
