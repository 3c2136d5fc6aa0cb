"""Pin rotation as a table (Qrkey §III-D): which state, on which event, does what, and is then in which state.

The states say which epochs live beside the current one. docs/spec/link.md draws its diagram from TABLE.
"""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """What lives beside the current epoch."""

    FIRST = "first"  # nothing: no rotation yet
    OVERLAP = "overlap"  # the old epoch, in full
    SETTLED = "settled"  # the last epoch, only to be told where to go


class Event(Enum):
    """What happens to a rotation."""

    ROTATE_DUE = "rotate due"
    OVERLAP_OVER = "overlap over"
    KNOCK = "knock"  # an authentic request under the last epoch, at most one a second
    RECONNECTED = "reconnected"


class Act(Enum):
    """What a server does, in the order of the table."""

    FORGET_LAST = "forget the last epoch"
    NEW_EPOCH = "make a new pin and subscribe to its topics"
    SEND_PIN = "publish the pin message under the old epoch"
    DROP_OLD = "keep nothing of the old epoch but its request topic"


TABLE: dict[tuple[State, Event], tuple[State, tuple[Act, ...]]] = {
    (State.FIRST, Event.ROTATE_DUE): (State.OVERLAP, (Act.NEW_EPOCH, Act.SEND_PIN)),
    (State.OVERLAP, Event.OVERLAP_OVER): (State.SETTLED, (Act.SEND_PIN, Act.DROP_OLD)),
    (State.SETTLED, Event.ROTATE_DUE): (State.OVERLAP, (Act.FORGET_LAST, Act.NEW_EPOCH, Act.SEND_PIN)),
    (State.SETTLED, Event.KNOCK): (State.SETTLED, (Act.SEND_PIN,)),
    # A pin message published while the broker was away reached nobody.
    (State.OVERLAP, Event.RECONNECTED): (State.OVERLAP, (Act.SEND_PIN,)),
    (State.SETTLED, Event.RECONNECTED): (State.SETTLED, (Act.SEND_PIN,)),
}


def step(state: State, event: Event) -> tuple[State, tuple[Act, ...]]:
    """The next state and what to do; an event that the table does not name changes nothing."""
    return TABLE.get((state, event), (state, ()))
