"""The byte table's page of the protocols beside flocking: what robots claim, and what they remember of each other.

Their robots run in plain Python (robot/controllers/protocols): no kernel reads these, so table.py does not list them.
"""

from __future__ import annotations

from .record import fields, record

KIND_CLAIM, KIND_SIGHTING = 0x0D, 0x0E
NOWHERE = 0xFFFF  # instead of a place's number

PLACES = fields(
    "here u16: number of the place where it is, or has been last; 0xFFFF: none",
    "holds u16: of the place that it goes to, and that is its own until then",
    "wants u16: of the place that it asks for next",
)
CLAIM = record(
    "claim: broadcast behind a `state`: which places a robot takes on",
    "id u16: robot id",
    "t u64: ms, a-node's clock",
    *PLACES,
    tag=KIND_CLAIM,
)
PEER = record(
    "peer: what is remembered of another robot of the mission, by rising id",
    "heard u64: ms, a-node's clock: its last claim",
    "x_m y_m f32: where it said it was",
    *PLACES,
)
PEER_MEMORY = record(
    "peer_memory: what a robot of these protocols remembers",
    *PLACES,
    "done u16: legs of its errands",
    "rest rest: a `peer` for each other robot",
)
VISIT = record(
    "visit: behind a `peer_memory`, of each place: who was there last",
    "at u64: ms, a-node's clock; 0: never",
    "id u16: of the robot that says it was there",
)
WAITING = record(
    "waiting: behind the `visit`s, of each other robot by rising id",
    "at u64: ms, a-node's clock: when it was said; 0: nothing waits",
    "place u16: where the robot said it had come to, which waits for its next word",
    "been u16: the last of its places that was believed; 0xFFFF: none",
)
SEEN = record(
    "seen: behind a `sensor` reading: what the robot sees beside itself",
    "number u16: of the nearest thing in sight; 0xFFFF: none",
    "dx_m dy_m f32: from the robot to it",
)
THING = fields("number u16: of a thing that moves; 0xFFFF: none", "x_m y_m f32: where it is")
SIGHTING = record(
    "sighting: broadcast behind a `claim`: what a robot sees",
    "id u16: robot id",
    "t u64: ms, a-node's clock",
    *THING,
    tag=KIND_SIGHTING,
)
SIGHTED = record(
    "sighted: behind a `peer_memory`, of each robot by rising id: what it said last that it sees",
    "at u64: ms, a-node's clock",
    *THING,
)
RECORDS = (CLAIM, PEER, PEER_MEMORY, VISIT, WAITING, SEEN, SIGHTING, SIGHTED)
