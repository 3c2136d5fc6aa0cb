"""What of a run a second processor does: what robots do alone, one after another, while the first goes on.

A robot that hears a broadcast, or decides without saying anything, changes nothing but itself. So the first processor,
which has the radio, the audits and the order of events, only notes it as an errand, and goes on; before it touches a
robot it waits until that robot's errands are done. Each robot's own events so come in their order, and results are
the same to the bit. Source: none.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import I64x1, Records, U8x1
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.memory import PATIENCE, look, rest, tell, wait_until
from phalanx.pages import dense
from phalanx.sim.radio.channel import SHORT_BYTES
from phalanx.wire.fields import Row, copy

ROOM = 1024
# Kinds: a robot's sensors are due, a frame has arrived, a request is on its way.
CONTROL, MESSAGE, FORETELL = 10, 16, 18
# Of `counts`, in lines of their own: errands done; those given, and requests among them; whether no more will come.
DONE, GIVEN, FORETOLD, ENDS = 0, 16, 17, 32

ERRAND = np.dtype(
    [
        ("now_us", "i8"),
        ("kind", "i4"),  # CONTROL, MESSAGE or FORETELL
        ("robot", "i4"),  # of FORETELL, the request's place
        ("length", "i8"),  # of the frame
        ("frame", "u1", (SHORT_BYTES,)),
    ],
    align=True,
)


class Errands(NamedTuple):
    """Errands that wait, in the order in which they were given."""

    on: U8x1  # (1,), whether there is a second processor
    errand: Annotated[Any, Records(ERRAND)]  # (ROOM,), each in its turn
    last: I64x1  # (N,), how many had been given with each robot's last
    steps: I64x1  # (N,), readings so far, as `Fleet.robot` has them when errands are done
    counts: I64x1  # (COUNT_WORDS,), that of what is foretold


pack = bundled(Errands)


def make_errands(robots: int, counts: NDArray[np.int64]) -> Errands:
    """None, counted in `counts`, and nobody to do them."""
    errands = Errands(
        on=np.zeros(1, np.uint8),
        errand=np.zeros(ROOM, ERRAND).view(np.recarray),
        last=dense(robots, np.int64),
        steps=dense(robots, np.int64),
        counts=counts,
    )
    return pack(errands)


@kernel
def give(errands: Errands, kind: int, robot: int, now_us: int, frame: Row, length: int) -> None:
    """The errand will be done; the first `length` bytes of `frame`, SHORT_BYTES at most, are its own."""
    given = errands.counts[GIVEN]
    wait_for(errands, given + 1 - ROOM)
    errand = errands.errand[given % ROOM]
    errand.now_us, errand.kind, errand.robot, errand.length = now_us, kind, robot, length
    copy(errand.frame, 0, frame, 0, length)
    if kind != FORETELL:
        errands.last[robot] = given + 1
    tell(errands.counts, GIVEN, given + 1)


@kernel
def wait_for(errands: Errands, number: int) -> None:
    """So many errands are done."""
    wait_until(errands.counts, DONE, number)


@kernel
def wait_for_all(errands: Errands) -> None:
    """No errand waits."""
    wait_for(errands, errands.counts[GIVEN])


@kernel
def wait_for_next(errands: Errands, done: int) -> bool:
    """There is one more than `done`; False if there never will be."""
    looks = 0
    while look(errands.counts, GIVEN) == done:
        if look(errands.counts, ENDS):
            return False
        looks += 1
        if looks % PATIENCE == 0:
            rest()
    return True
