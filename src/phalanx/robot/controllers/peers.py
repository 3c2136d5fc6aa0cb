"""Common part of protocols: a robot that broadcasts its position and claims, and stores those of others.

The mission lists its robots, so messages of invented robots are ignored: each robot stores an entry for every other
robot. Silent robots are not removed, because they still stand in the way. Source: RoboRebound §2.1;
docs/guides/protocols.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from phalanx.wire.protocols import CLAIM, KIND_CLAIM, NOWHERE, PEER, PEER_MEMORY
from phalanx.wire.record import MalformedRecord

from .peer_bodies import FIRST_VALUE, ID, DrivenWheels, PeerBody, fields_of, is_fine
from .protocol import Point, Task
from .python_controller import Controller, Output, Send

# Broadcast periods of silence after which a robot counts as stopped.
SILENT_PERIODS = 4


@dataclass(slots=True)
class Peer:
    """Last claim of another robot, received at `heard_ms`."""

    heard_ms: int
    x_m: float
    y_m: float
    here: int = NOWHERE
    holds: int = NOWHERE
    wants: int = NOWHERE


class PeerController(Controller, ABC):
    """Robot that claims places, and broadcasts its claims.

    Class attributes:
        pace_mps: top speed along each axis; wheels have their own.

    Attributes:
        here, holds, wants: numbers of places: its current place, its target, and the next one that it requests.
        done: number of finished steps of its work.
        others: last claims of the other robots, by rising id.
    """

    pace_mps: ClassVar[float] = 3.0
    is_ours = True

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id)
        self.task = task
        self.body = (
            PeerBody(rob_id, self.pace_mps)
            if task.wheels is None
            else DrivenWheels(rob_id, task.wheels, keeps_apart=task.keeps_apart)
        )
        self.period_ms = task.state_every * task.control_ms  # from one broadcast to the next
        self.here = self.holds = self.wants = NOWHERE
        self.done = 0
        self.others = {other: Peer(0, *place) for other, place in enumerate(task.starts_m, 1) if other != rob_id}

    # --- hooks for protocols -------------------------------------------------------------------------------------

    @abstractmethod
    def turn(self, t_ms: int, place_m: Point) -> None:
        """Update `here`, `holds` and `wants`; called before each broadcast."""

    @abstractmethod
    def target_point(self) -> Point:
        """Return the point to drive to, m."""

    def told(self, rob_id: int, t_ms: int, before_ms: int) -> None:
        """Handle a claim, already stored in `others`, of a robot whose previous one came at `before_ms`."""

    # --- common to all protocols ---------------------------------------------------------------------------------

    def is_silent(self, other: Peer, t_ms: int) -> bool:
        """Return whether a robot has been silent for so long that it counts as stopped or absent."""
        return t_ms - other.heard_ms > SILENT_PERIODS * self.period_ms

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Store a message of another robot of the mission; pass anything else to the body."""
        if (claim := fields_of(CLAIM, packet)) and (other := self.others.get(claim[ID])):
            before_ms, other.heard_ms = other.heard_ms, t_ms
            other.here, other.holds, other.wants = claim[FIRST_VALUE:]
            self.told(claim[ID], t_ms, before_ms)
        elif position := self.body.position_in(packet):
            if other := self.others.get(position[0]):
                _, other.x_m, other.y_m = position
        else:
            self.body.on_recv(t_ms, packet)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """Return a command, and when a broadcast is due, the robot's position and claims."""
        place_m = self.body.where(reading)
        if place_m is None:  # an invalid reading: coast, and broadcast nothing
            return self.body.drive(step, t_ms, reading, None, speaks=False)
        for other in self.others.values() if step == 0 else ():
            other.heard_ms = t_ms  # at the start, no robot counts as silent
        speaks = (step + self.rob_id) % self.task.state_every == 0
        if speaks:
            self.turn(t_ms, place_m)
        outputs = self.body.drive(step, t_ms, reading, self.target_point(), speaks=speaks)
        if speaks:
            places = self.here, self.holds, self.wants
            outputs.append(Send(CLAIM.form.pack(KIND_CLAIM, self.rob_id, t_ms, *places)))
        return outputs

    def encode(self) -> bytes:
        """Encode the body's state and a `peer_memory`."""
        peers = b"".join(
            PEER.form.pack(each.heard_ms, each.x_m, each.y_m, each.here, each.holds, each.wants)
            for each in self.others.values()
        )
        return self.body.encode() + PEER_MEMORY.form.pack(self.here, self.holds, self.wants, self.done) + peers

    def decode(self, encoding: bytes) -> None:
        """Restore a checkpoint. Raises: MalformedRecord: not a state of this robot."""
        memory = PEER_MEMORY.decode(self.body.decode(encoding))
        if len(memory["rest"]) != PEER.size * len(self.others):
            raise MalformedRecord(f"{len(memory['rest'])} bytes for {len(self.others)} other robots")
        peers = PEER.form.iter_unpack(memory["rest"])
        self.others = {rob_id: Peer(*peer) for rob_id, peer in zip(self.others, peers, strict=True)}
        if not all(is_fine(each.x_m) and is_fine(each.y_m) for each in self.others.values()):
            raise MalformedRecord("the position of a robot is out of range")
        self.here, self.holds, self.wants = memory["here"], memory["holds"], memory["wants"]
        self.done = memory["done"]
