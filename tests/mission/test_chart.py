"""Which known landmarks a thing in sight may be: asked of all at once, as of one after the other."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from phalanx.config.mission import MissionConfig
from phalanx.mission import Experience, Landmark
from phalanx.mission.pose.spread import pose_spread
from phalanx.mission.walk.chart import Chart
from phalanx.mission.walk.fix import fits, sight_of, sighting

CONFIG = MissionConfig()
places = st.floats(-3, 3)
landmarks = st.builds(
    Landmark,
    st.sampled_from(["doorway", "concave_left", "room", "qr"]),
    places,
    places,
    st.one_of(st.none(), st.floats(-7, 7)),
    st.none(),
    st.sampled_from([None, "a", "b"]),
)


def candidate_matches(seen: Experience, landmark: Landmark, known: Landmark) -> bool:
    if (landmark.type, landmark.text) != (known.type, known.text):
        return False
    if math.hypot(known.x_m - landmark.x_m, known.y_m - landmark.y_m) > CONFIG.tolerance_m:
        return False
    match = sighting(landmark, known, landmark.x_m, landmark.y_m)
    return fits(CONFIG, pose_spread(seen.spread), seen.x_m, seen.y_m, match)


@given(st.lists(landmarks, max_size=5), st.lists(landmarks, max_size=5), st.floats(0.01, 0.5), st.floats(0.001, 0.3))
def test_what_a_thing_may_be_is_told_of_all_as_of_each(sighted, known, metres, radians):
    spread = (metres**2, 0.0, 0.0, metres**2, 0.0, radians**2)
    seen = Experience(0.0, 0.3, -0.2, 0.0, landmarks=tuple(sighted), spread=spread)
    expected = [[j for j, each in enumerate(known) if candidate_matches(seen, landmark, each)] for landmark in sighted]
    assert Chart(known).fitting(seen, sight_of(CONFIG), CONFIG.tolerance_m) == expected
