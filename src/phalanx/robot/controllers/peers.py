"""The common part of protocols: a robot that says where it is and what it takes on, and knows what others said.

The mission names its robots, so a compromised robot's invented ones are nobody: each robot remembers the others, no
more and no less. None is forgotten, for one that is silent still stands there. Source: RoboRebound §2.1;
docs/guides/protocols.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from phalanx.wire.protocols import CLAIM, KIND_CLAIM, NOWHERE, PEER, PEER_MEMORY
from phalanx.wire.record import MalformedRecord

from .peer_bodies import BEHIND_T, ID, DrivenWheels, PeerBody, fields_of, is_fine
from .protocol import Point, Task
from .python_controller import Controller, Output, Send

# Periods of broadcasts after which who has not been heard is taken to be silent for good.
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
    """A robot that takes on one place after another, and says so.

    Class attributes:
        pace_mps: its top speed along each axis; wheels have their own.

    Attributes:
        here, holds, wants: numbers of places: where it is, where it goes, what it asks for next.
        done: how far it is with what it has to do.
        others: by id, rising.
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

    # --- what a protocol decides ---------------------------------------------------------------------------------

    @abstractmethod
    def turn(self, t_ms: int, place_m: Point) -> None:
        """It is about to speak: what it has reached, takes on, and asks for, is up to date."""

    @abstractmethod
    def aim(self) -> Point:
        """Return the point that it drives to, m."""

    def told(self, rob_id: int, t_ms: int, before_ms: int) -> None:
        """Another robot, which was heard last at `before_ms`, has claimed places, remembered by now."""

    # --- what all do ---------------------------------------------------------------------------------------------

    def is_silent(self, other: Peer, t_ms: int) -> bool:
        """Return whether it has been so long silent that it has stopped, or was never there."""
        return t_ms - other.heard_ms > SILENT_PERIODS * self.period_ms

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Store a message of another robot of the mission; pass anything else to the body."""
        if (said := fields_of(CLAIM, packet)) and (other := self.others.get(said[ID])):
            before_ms, other.heard_ms = other.heard_ms, t_ms
            other.here, other.holds, other.wants = said[BEHIND_T:]
            self.told(said[ID], t_ms, before_ms)
        elif where := self.body.position_in(packet):
            if other := self.others.get(where[0]):
                _, other.x_m, other.y_m = where
        else:
            self.body.on_recv(t_ms, packet)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """It drives; and in its turn it decides, and says where it is and what it takes on."""
        place_m = self.body.where(reading)
        if place_m is None:  # a reading that makes no sense: coast, and say nothing
            return self.body.drive(step, t_ms, reading, None, speaks=False)
        for other in self.others.values() if step == 0 else ():
            other.heard_ms = t_ms  # nobody is silent yet
        speaks = (step + self.rob_id) % self.task.state_every == 0
        if speaks:
            self.turn(t_ms, place_m)
        outputs = self.body.drive(step, t_ms, reading, self.aim(), speaks=speaks)
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
        """Back to a checkpoint. Raises: MalformedRecord: not one of this robot's."""
        memory = PEER_MEMORY.decode(self.body.decode(encoding))
        if len(memory["rest"]) != PEER.size * len(self.others):
            raise MalformedRecord(f"{len(self.others)} others, and {len(memory['rest'])} bytes of them")
        peers = PEER.form.iter_unpack(memory["rest"])
        self.others = {rob_id: Peer(*said) for rob_id, said in zip(self.others, peers, strict=True)}
        if not all(is_fine(each.x_m) and is_fine(each.y_m) for each in self.others.values()):
            raise MalformedRecord("a robot is nowhere")
        self.here, self.holds, self.wants = memory["here"], memory["holds"], memory["wants"]
        self.done = memory["done"]
