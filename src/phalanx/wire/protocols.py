"""Records of the protocols beside flocking: claims, sightings, and robots' memory of each other.

Controllers of these protocols are plain Python (robot/controllers/protocols), so table.py does not list the records.
"""

from __future__ import annotations

from .record import fields, record

KIND_CLAIM, KIND_SIGHTING = 0x0D, 0x0E
NOWHERE = 0xFFFF  # in place of a place number: none

PLACES = fields(
    "here u16: place number of its current or last place; 0xFFFF: none",
    "holds u16: place number of its destination, reserved for it until it arrives",
    "wants u16: place number of the place that it requests next",
)
CLAIM = record(
    "claim: broadcast after a `state`: places that a robot occupies, has reserved and requests",
    "id u16: robot id",
    "t u64: ms, a-node's clock",
    *PLACES,
    tag=KIND_CLAIM,
)
PEER = record(
    "peer: memory of another robot of the mission, by rising id",
    "heard u64: ms, a-node's clock at its last claim",
    "x_m y_m f32: position that it broadcast",
    *PLACES,
)
PEER_MEMORY = record(
    "peer_memory: memory of a robot of these protocols",
    *PLACES,
    "done u16: completed legs of its errands",
    "rest rest: a `peer` for each other robot",
)
VISIT = record(
    "visit: after a `peer_memory`, for each place: the last robot that claimed to be there",
    "at u64: ms, a-node's clock; 0: never",
    "id u16: id of that robot",
)
WAITING = record(
    "waiting: after the `visit`s, for each other robot by rising id: a visit not yet accepted",
    "at u64: ms, a-node's clock at the claim; 0: none",
    "place u16: place that the robot claimed to have reached; its next claim decides",
    "been u16: the last of its places that was accepted; 0xFFFF: none",
)
SEEN = record(
    "seen: after a `sensor` reading: the nearest thing that the robot sees",
    "number u16: number of the thing; 0xFFFF: none",
    "dx_m dy_m f32: vector from the robot to the thing",
)
THING = fields("number u16: number of a moving thing; 0xFFFF: none", "x_m y_m f32: its position")
SIGHTING = record(
    "sighting: broadcast after a `claim`: a thing that a robot sees",
    "id u16: robot id",
    "t u64: ms, a-node's clock",
    *THING,
    tag=KIND_SIGHTING,
)
SIGHTED = record(
    "sighted: after a `peer_memory`, for each robot by rising id: its last sighting",
    "at u64: ms, a-node's clock",
    *THING,
)
RECORDS = (CLAIM, PEER, PEER_MEMORY, VISIT, WAITING, SEEN, SIGHTING, SIGHTED)
