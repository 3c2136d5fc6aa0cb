"""The files that `phalanx keys` hands out: a mission's key, sealed for each robot, and what a board is made with.

Neither is trusted: trusted nodes check the one, and take the other once.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from phalanx.bti.nodes import MissionKey
from phalanx.config.written import read_at_most
from phalanx.errors import PeerError, UsageError
from phalanx.wire.table import BOARD, KEY_BYTES, MAC_BYTES

MOST_BYTES = 1 << 24  # of 65 535 robots


def issued(
    number: int,
    sealed: Mapping[int, MissionKey],
    signers: Mapping[str, str],
    signed: Mapping[str, Any] = MappingProxyType({}),
) -> bytes:
    """The file of a mission's key: public signing keys, and what only the robots' nodes can read.

    `signed` is the owner's word for which mission it is, if there is one.
    """
    robots = {robot: {"k": key.k.hex(), "r": key.r.hex(), "mac": key.mac.hex()} for robot, key in sealed.items()}
    said = {"mission": number, "signers": signers, **({"signed": dict(signed)} if signed else {}), "robots": robots}
    return json.dumps(said, indent=1).encode() + b"\n"


def read_mission_key(path: Path, robot: int) -> MissionKey:
    """One robot's key in a file of `issued`. Raises: UsageError: it is none, or not for this robot; Unavailable."""
    hint = "phalanx keys issue makes one"
    try:
        told: Any = json.loads(read_at_most(path, MOST_BYTES, hint))
        number, robots = int(told["mission"]), told["robots"]
        if str(robot) not in robots:
            raise UsageError(f"{path} has no key for robot {robot}", "phalanx keys list shows who gets one")
        k, r, mac = (bytes.fromhex(robots[str(robot)][name]) for name in ("k", "r", "mac"))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{path} is no mission key", hint) from error
    if not len(k) == len(r) == KEY_BYTES or len(mac) != MAC_BYTES or not 1 <= number < 1 << 32:
        raise UsageError(f"{path} is no mission key", hint)
    return MissionKey(k, r, number, mac)


def read_mission_number(path: Path) -> int:
    """The mission's number in a file of `issued`. Raises: UsageError: it is none; Unavailable."""
    hint = "phalanx keys issue makes one"
    try:
        number = int(json.loads(read_at_most(path, MOST_BYTES, hint))["mission"])
        if not 1 <= number < 1 << 32:
            raise ValueError(number)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{path} is no mission key", hint) from error
    return number


def read_board(path: Path, robot: int) -> bytes:
    """The master key in a file of `phalanx keys provision`. Raises: UsageError: it is another robot's, or none."""
    hint = "phalanx keys provision makes one"
    try:
        board = BOARD.decode(read_at_most(path, MOST_BYTES, hint))
    except PeerError as error:
        raise UsageError(f"{path} is not what a board is made with", hint) from error
    if board["id"] != robot:
        raise UsageError(f"{path} is for robot {board['id']}, and this is robot {robot}", hint)
    master: bytes = board["master"]
    return master
