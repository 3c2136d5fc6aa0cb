"""Mode session: a key for each visitor, over a websocket or any MQTT broker. No I/O: callers do it."""

from .client import SessionClient
from .door import Ticket
from .errors import EndReason, Reason
from .events import Now
from .invitation import BadInvitation, Invitation, is_session_url, parse_invitation, parse_room_code, shown_room_code
from .messages import Role
from .operations import Operations
from .secret import Kind, Secret
from .server import SessionServer
from .store import MemoryStore, Store

__all__ = [
    "BadInvitation",
    "EndReason",
    "Invitation",
    "Kind",
    "MemoryStore",
    "Now",
    "Operations",
    "Reason",
    "Role",
    "Secret",
    "SessionClient",
    "SessionServer",
    "Store",
    "Ticket",
    "is_session_url",
    "parse_invitation",
    "parse_room_code",
    "shown_room_code",
]
