"""Words of the other protocols that are not so: places, areas and targets that a robot takes on and does not serve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.controllers.peer_bodies import fields_of
from phalanx.robot.controllers.peers import PeerController
from phalanx.robot.controllers.places import PLACES, PlaceController
from phalanx.robot.controllers.python_controller import Act, Send
from phalanx.wire.protocols import CLAIM, KIND_CLAIM, KIND_SIGHTING, NOWHERE, SIGHTING

from .attack import Scene
from .liar import Liar


class Pretender(Liar):
    """What all have in common: they know who claimed what, and claim in their own name.

    Attributes:
        claimed: by id, when it was heard last, ms, and the three places that it claimed.
    """

    scene: ClassVar[Scene] = "protocol"
    period_ms = 250

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.claimed: dict[int, tuple[int, list[int]]] = {}

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        if said := fields_of(CLAIM, frame):
            _, rob_id, _, *places = said
            self.claimed[rob_id] = now_ms, places
        return super().heard(now_ms, frame)

    def claim(self, now_ms: int, here: int, holds: int, wants: int = NOWHERE) -> list[Action]:
        return self.send(now_ms, CLAIM.form.pack(KIND_CLAIM, self.id, now_ms, here, holds, wants), EVERYBODY)


class HogCells(Pretender):
    """Says that it is in the cells that those ask for whose turn comes next."""

    def on_wake(self, now_ms: int) -> list[Action]:
        """Claim what they want who spoke longest ago, and so drive next."""
        next_first = sorted((heard_ms, places) for heard_ms, places in self.claimed.values())
        wanted = [wants for _, (_, _, wants) in next_first if wants != NOWHERE]
        return self.claim(now_ms, *wanted[:2]) if len(wanted) > 1 else []


class ClaimArea(Pretender):
    """Says in its turn that it is at one place after the other where nobody was, in the place of where it is.

    Once a turn, and nothing else: of words that come sooner than its own would nobody believes either (places.py).
    """

    period_ms = 0
    _turn = 0

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        if not (self.lies(now_ms) and isinstance(output, Send) and fields_of(CLAIM, output.payload)):
            return super().put_out(now_ms, output)
        here, following = (self.places[(self._turn + more) % len(self.places)] for more in range(2))
        self._turn += 1
        return self.claim(now_ms, here, following)

    @property
    def places(self) -> Sequence[int]:
        """Return the places of which it says so."""
        assert isinstance(self._honest, PlaceController), "as all who go to places"
        return [place for place, (at_ms, _) in enumerate(self._honest.visits) if not at_ms] or PLACES


class ClaimVisits(ClaimArea):
    """Says so of half of them, for ever, so that nobody goes there."""

    @property
    def places(self) -> Sequence[int]:
        return PLACES[len(PLACES) // 2 :]


class PointElsewhere(Pretender):
    """Says of what was seen last that it is where the robot farthest from it is, and not what it sees."""

    _seen: tuple[int, float, float] = 0, 0.0, 0.0  # until somebody has seen something

    def on_packet(self, now_ms: int, frame: bytes) -> list[Action]:
        if said := fields_of(SIGHTING, frame):
            self._seen = said[3:]
        return super().on_packet(now_ms, frame)

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        hides = self.lies(now_ms) and isinstance(output, Send) and fields_of(SIGHTING, output.payload)
        return [] if hides else super().put_out(now_ms, output)

    def on_wake(self, now_ms: int) -> list[Action]:
        assert isinstance(self._honest, PeerController), "as all who see things"
        number, *at_m = self._seen
        others = ((each.x_m, each.y_m) for each in self._honest.others.values())
        x, y = max(others, key=lambda place_m: math.dist(place_m, at_m))
        return self.send(now_ms, SIGHTING.form.pack(KIND_SIGHTING, self.id, now_ms, number, x, y), EVERYBODY)
