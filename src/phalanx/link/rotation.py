"""State machine of pin rotation, as a table from state and event to the next state and actions (Qrkey §III-D).

A state names the epochs that are live beside the current one. The diagram in docs/spec/link.md is drawn from TABLE.
"""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """Epochs that are live beside the current one."""

    FIRST = "first"  # nothing: no rotation yet
    OVERLAP = "overlap"  # the old epoch, in full
    SETTLED = "settled"  # of the last epoch only the request topic, for phones that missed the rotation


class Event(Enum):
    """Input of the state machine."""

    ROTATE_DUE = "rotate due"
    OVERLAP_OVER = "overlap over"
    KNOCK = "knock"  # an authentic request under the last epoch, at most one a second
    RECONNECTED = "reconnected"


class Act(Enum):
    """Action of the server, in the order of the table."""

    FORGET_LAST = "forget the last epoch"
    NEW_EPOCH = "make a new pin and subscribe to its topics"
    SEND_PIN = "publish the pin message under the old epoch"
    DROP_OLD = "keep nothing of the old epoch but its request topic"


TABLE: dict[tuple[State, Event], tuple[State, tuple[Act, ...]]] = {
    (State.FIRST, Event.ROTATE_DUE): (State.OVERLAP, (Act.NEW_EPOCH, Act.SEND_PIN)),
    (State.OVERLAP, Event.OVERLAP_OVER): (State.SETTLED, (Act.SEND_PIN, Act.DROP_OLD)),
    (State.SETTLED, Event.ROTATE_DUE): (State.OVERLAP, (Act.FORGET_LAST, Act.NEW_EPOCH, Act.SEND_PIN)),
    (State.SETTLED, Event.KNOCK): (State.SETTLED, (Act.SEND_PIN,)),
    # A pin message published while the broker was unreachable was lost.
    (State.OVERLAP, Event.RECONNECTED): (State.OVERLAP, (Act.SEND_PIN,)),
    (State.SETTLED, Event.RECONNECTED): (State.SETTLED, (Act.SEND_PIN,)),
}


def step(state: State, event: Event) -> tuple[State, tuple[Act, ...]]:
    """Return the next state and the actions; an event that is not in the table changes nothing."""
    return TABLE.get((state, event), (state, ()))
