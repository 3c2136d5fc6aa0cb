"""Which events change nothing but one robot, so that a second processor may see to them (errands.py)."""

from __future__ import annotations

from phalanx.bti import request
from phalanx.kernel import kernel
from phalanx.robot.controllers import dispatch
from phalanx.sim.radio.channel import SHORT_BYTES
from phalanx.wire.fields import copy

from .errands import FORETELL, FORETOLD, GIVEN, give, wait_for
from .world import PYTHON, World


@kernel
def meet(world: World, i: int) -> None:
    """The robot's errands are done."""
    if world.errands.on[0] and i < len(world.errands.last):
        wait_for(world.errands, world.errands.last[i])


@kernel
def is_compiled(world: World, i: int) -> bool:
    """Whether there is a second processor, for a robot that does not run in Python and is not in Safe Mode."""
    return bool(world.errands.on[0] and i < len(world.runs) and world.runs[i] != PYTHON and world.safe[i] == 0)


@kernel
def hears_alone(world: World, j: int) -> bool:
    """Whether the frame that arrives at robot j changes nothing but that robot: nothing about audits, or a HELLO."""
    frame, length = world.frame, world.frame_len[0]
    if not is_compiled(world, j) or length > SHORT_BYTES:
        return False
    return bool(
        not frame[0] & request.AUDIT or (length == request.AUDIT_HEAD_BYTES and frame[request.AT_SUB] == request.HELLO)
    )


@kernel
def will_decide_alone(world: World, i: int) -> bool:
    """Whether what the robot does at its next reading changes nothing but itself."""
    if not is_compiled(world, i):
        return False
    controller = world.fleet.settings[0].controller
    return dispatch.is_silent(controller, world.fleet.params, i + 1, world.errands.steps[i])


@kernel
def decides_alone(world: World, i: int) -> bool:
    """Whether what the robot does at this reading changes nothing but itself."""
    alone = will_decide_alone(world, i)
    world.errands.steps[i] += 1
    return alone


@kernel
def foretell(world: World, i: int) -> None:
    """The request that robot i has made will have been audited when it arrives."""
    f, e, known = world.fleet, world.errands, world.fleet.memo.foretold
    if f.settings[0].controller == 0:
        return
    r, at = f.robot[i], e.counts[FORETOLD] % len(known.told)
    e.counts[FORETOLD] += 1
    told = known.told[at]
    wait_for(e, told.number)
    copy(known.shown[at], 0, f.request.rows[r.request_row], 0, r.request_len)
    told.number, told.tee, told.length = e.counts[GIVEN] + 1, i + 1, r.request_len
    known.place[i] = at
    give(e, FORETELL, at, world.clock[0].now_us, world.frame, 0)
