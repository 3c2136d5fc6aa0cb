"""The byte table's page of the protocols beside flocking: what robots claim, and what they remember of each other.

Their robots run in plain Python (robot/controllers/protocols): no kernel reads these, so table.py does not list them.
"""

from __future__ import annotations

from .record import Field, Record

KIND_CLAIM, KIND_SIGHTING = 0x0D, 0x0E
NOWHERE = 0xFFFF  # instead of a place's number

PLACES = (
    Field("here", "u16", "number of the place where it is, or has been last; 0xFFFF: none"),
    Field("holds", "u16", "of the place that it goes to, and that is its own until then"),
    Field("wants", "u16", "of the place that it asks for next"),
)
CLAIM = Record(
    "claim",
    (Field("id", "u16", "robot id"), Field("t", "u64", "ms, a-node's clock"), *PLACES),
    "broadcast behind a `state`: which places a robot takes on",
    KIND_CLAIM,
)
PEER = Record(
    "peer",
    (
        Field("heard", "u64", "ms, a-node's clock: its last claim"),
        Field("x_m", "f32", "where it said it was"),
        Field("y_m", "f32", ""),
        *PLACES,
    ),
    "what is remembered of another robot of the mission, by rising id",
)
PEER_MEMORY = Record(
    "peer_memory",
    (*PLACES, Field("done", "u16", "legs of its errands"), Field("rest", "rest", "a `peer` for each other robot")),
    "what a robot of these protocols remembers",
)
VISIT = Record(
    "visit",
    (Field("at", "u64", "ms, a-node's clock; 0: never"), Field("id", "u16", "of the robot that says it was there")),
    "behind a `peer_memory`, of each place: who was there last",
)
WAITING = Record(
    "waiting",
    (
        Field("at", "u64", "ms, a-node's clock: when it was said; 0: nothing waits"),
        Field("place", "u16", "where the robot said it had come to, which waits for its next word"),
        Field("been", "u16", "the last of its places that was believed; 0xFFFF: none"),
    ),
    "behind the `visit`s, of each other robot by rising id",
)
SEEN = Record(
    "seen",
    (
        Field("number", "u16", "of the nearest thing in sight; 0xFFFF: none"),
        Field("dx_m", "f32", "from the robot to it"),
        Field("dy_m", "f32", ""),
    ),
    "behind a `sensor` reading: what the robot sees beside itself",
)
THING = (
    Field("number", "u16", "of a thing that moves; 0xFFFF: none"),
    Field("x_m", "f32", "where it is"),
    Field("y_m", "f32", ""),
)
SIGHTING = Record(
    "sighting",
    (Field("id", "u16", "robot id"), Field("t", "u64", "ms, a-node's clock"), *THING),
    "broadcast behind a `claim`: what a robot sees",
    KIND_SIGHTING,
)
SIGHTED = Record(
    "sighted",
    (Field("at", "u64", "ms, a-node's clock"), *THING),
    "behind a `peer_memory`, of each robot by rising id: what it said last that it sees",
)
RECORDS = (CLAIM, PEER, PEER_MEMORY, VISIT, WAITING, SEEN, SIGHTING, SIGHTED)
