"""Sines, cosines and arctangents without a libm."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.mission import angles

ANGLE = st.floats(-1000, 1000)
NUMBER = st.floats(-1e6, 1e6)


@settings(deadline=None)  # on a busy machine a call waits
@given(ANGLE)
def test_sines_and_cosines_are_those_of_the_library(angle):
    sine, cosine = angles.sin_cos(angle)
    assert abs(sine - math.sin(angle)) < 5e-15
    assert abs(cosine - math.cos(angle)) < 5e-15


@settings(deadline=None)  # on a busy machine a call waits
@given(NUMBER, NUMBER)
def test_arctangents_are_those_of_the_library(y, x):
    if x or y:
        # The negative half axis belongs to pi, whatever the sign of zero.
        expected = math.pi if y == 0 and x < 0 else math.atan2(y, x)
        assert abs(angles.atan2(y, x) - expected) < 1e-15
    else:
        assert angles.atan2(y, x) == 0


@settings(deadline=None)  # on a busy machine a call waits
@given(ANGLE)
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = angles.wrap(angle)
    assert abs(wrapped) <= math.pi + 1e-12
    assert abs(math.sin(wrapped - angle)) < 1e-12
    assert math.cos(wrapped - angle) > 0


@settings(deadline=None)  # on a busy machine a call waits
@given(ANGLE, NUMBER, NUMBER)
def test_compiled_and_plain_agree_to_the_bit(angle, y, x):
    assert angles.sin_cos(angle) == angles.sin_cos.py_func(angle)
    assert angles.atan2(y, x) == angles.atan2.py_func(y, x)
    assert angles.wrap(angle) == angles.wrap.py_func(angle)
