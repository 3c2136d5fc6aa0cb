"""Why a mission that came from outside is refused."""

from __future__ import annotations

from phalanx.errors import PeerError


class MalformedMission(PeerError):
    """Not the bytes of a mission file, a start key or a payload."""

    reason = "malformed_mission"


class Unsigned(PeerError):
    """Nobody signed this mission, or somebody who is not trusted."""

    reason = "unsigned"


class Altered(PeerError):
    """What was decoded does not fit the file around it: a record was changed or put somewhere else."""

    reason = "altered"


class NotForUs(PeerError):
    """The mission names other robots."""

    reason = "not_for_us"


class OutsideWindow(PeerError):
    """The mission begins later, or is over."""

    reason = "outside_window"


class AlreadyStarted(PeerError):
    """This robot has started this mission before, and it may be started once."""

    reason = "already_started"
