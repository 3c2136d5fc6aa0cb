"""Calls something that robots run for the first time, which compiles it: `first_call.py flock`.

Each of them can be called beside the others.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys

from phalanx.demo.rehearsal import rehearse
from phalanx.demo.simulated import mission_swarm
from phalanx.sim.building.floorplan import load_floorplan


def phalanx(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "phalanx", *words, "--json"], stdout=subprocess.DEVNULL, check=True)


def flock() -> None:
    phalanx("sim", "run", "flock-12", "--duration", "0.5")


def gateway() -> None:
    rehearse("bound")


def mission() -> None:
    phalanx("mission", "run", "delivery", "--robots", "1")


def building() -> None:
    with mission_swarm(load_floorplan(), None, 4, 0, None, None, print) as swarm:
        asyncio.run(swarm.ready())


CALLS = {call.__name__: call for call in (flock, gateway, mission, building)}

if __name__ == "__main__":
    CALLS[sys.argv[1]]()
