"""What is read next is asked for ahead of time: of large swarms nobody's memory is near, and all would wait for it.

Nothing here changes anything. Which bytes are asked for, and how early, is what was measured to be fastest.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.memory import fetch
from phalanx.pages import LINE_BYTES
from phalanx.sim.radio.channel import ATTEMPT, SHORT_BYTES, TX_END
from phalanx.wire.fields import whole

from .events import CONTROL, NOTHING, peek
from .world import World

# What is read of each robot at every event lies at the front of its rows; of its controller's state, most are so long.
HOT_BYTES, STATE_BYTES = 192, 256
# Where tokens lie in an a-node (firmware/include/phx.h), and how far ahead they are asked for.
TOKENS_AT, NODES_AHEAD = 704, 8


@kernel
def fetch_next(world: World) -> None:
    """What the next event reads is on its way."""
    kind, i, arg = peek(world.queue)
    air = world.air
    if kind == CONTROL:
        fetch_robot(world, i)
        fetch_body(world, i)
    elif kind == ATTEMPT:
        fetch(air.nic, i, 0, air.nic.itemsize)
        fetch(air.slot, 0, i * air.slot.itemsize, 1)
        fetch(air.short, 0, i * SHORT_BYTES, 1)
    elif kind == TX_END:
        # An answer lets its hearer go on; a frame for one robot is heard by that.
        fetch_robot(world, arg - 1 if arg > 0 else whole(air.slot[air.nic[i].head, i].dst))
    elif kind != NOTHING:
        fetch_robot(world, i)


@kernel
def fetch_body(world: World, i: int) -> None:
    """What robot i's sensors read, and its actuators, is on its way."""
    fetch(world.fleet.snode, i, 0, HOT_BYTES)
    fetch(world.pos, i, 0, 1)
    fetch(world.vel, i, 0, 1)
    fetch(world.acc, i, 0, 1)


@kernel
def fetch_robot(world: World, i: int) -> None:
    """What robot i reads to hear a frame, or to decide, is on its way."""
    f = world.fleet
    if 0 <= i < len(f.robot):
        fetch(f.robot, i, 0, HOT_BYTES)
        fetch(f.anode, i, 0, HOT_BYTES)
        fetch(f.state, i, 0, STATE_BYTES)
        fetch(f.peer_id, i, 0, 1)


@kernel
def fetch_log(world: World, i: int) -> None:
    """Where robot i logs next is on its way."""
    f, at = world.fleet, world.fleet.robot[i].log_len
    front = f.log.shape[1]
    if at < front:
        fetch(f.log, i, at, 1)
    else:
        fetch(f.log_rest, i, at - front, 1)


@kernel
def fetch_tokens(world: World, i: int) -> None:
    """What the a-node of a robot a few behind robot i reads to check its tokens is on its way."""
    fetch(world.fleet.anode, i + NODES_AHEAD, 0, HOT_BYTES)
    fetch(world.fleet.anode, i + NODES_AHEAD, TOKENS_AT, HOT_BYTES - LINE_BYTES)
