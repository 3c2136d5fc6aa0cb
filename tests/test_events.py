"""The queue of events against a sorted list."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.errors import UsageError
from phalanx.world.audited.events import NEVER_US, NOTHING, make_queue, next_us, peek, pop, push, refused

# Few times and many events, so that most of them tie; None takes one out.
actions = st.lists(st.one_of(st.integers(0, 5), st.integers(0, 1 << 52), st.none()), max_size=120)


@given(actions, st.integers(1, 40))
@settings(deadline=None)  # on a busy machine an example waits
def test_events_come_out_by_time_and_those_of_one_time_as_they_went_in(steps, capacity):
    queue, model, turned_away = make_queue(capacity), [], 0
    for number, t_us in enumerate(steps):
        if t_us is None:
            expected = min(model) if model else (NEVER_US, NOTHING, NOTHING, NOTHING)
            assert next_us(queue) == expected[0]
            assert peek(queue) == (7 + expected[1] if model else NOTHING)
            assert pop(queue) == ((expected[0], 7, 7 + expected[1], -expected[1]) if model else expected)
            if model:
                model.remove(expected)
        elif len(model) < capacity:
            assert push(queue, t_us, 7, 7 + number, -number) == 0
            model.append((t_us, number))
        else:
            before = queue.event.copy()
            assert push(queue, t_us, 7, 7 + number, -number) == -1
            turned_away += 1
            assert np.array_equal(queue.event, before)
    for t_us, number in sorted(model):
        assert pop(queue) == (t_us, 7, 7 + number, -number)
    assert pop(queue) == (NEVER_US, NOTHING, NOTHING, NOTHING)
    assert refused(queue) == turned_away


def test_a_queue_without_room_cannot_be_made():
    with pytest.raises(UsageError) as caught:
        make_queue(0)
    assert caught.value.hint
