"""What robots that audit each other run is compiled before visitors wait for it, once on a machine.

`python -m phalanx.demo.rehearsal DEFENCE PROTOCOL` does it at low priority, in a process of its own: a gateway goes on.
PROTOCOL is "" for none.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

import phalanx
from phalanx.errors import Unavailable
from phalanx.io.children import die_with_parent
from phalanx.kernel import kept_in
from phalanx.robot import Led, Point
from phalanx.sim.audited import loop
from phalanx.sim.compiling import telling_of_compiling
from phalanx.sim.swarms.protected import ProtectedSwarm

# Long enough for a round of audits, for attacks to be refused, and for the robots to be stopped.
REHEARSAL_S = 12.0
PIECE_S = 0.1
NICE = 10


def is_compiled(defence: str, protocol: str = "") -> bool:
    """Whether a rehearsal has come to its end on this machine, with these kernels."""
    note = _note(defence, protocol)
    return note is None or note.exists()


def rehearse(defence: str, protocol: str = "", wanted: Callable[[], bool] = lambda: True) -> None:
    """Every order is given and every attack is run, in a swarm of its own; or a part of that, if no more is wanted.

    So it is all compiled, kept on disk, and loaded into this process; with a `protocol`, what its robots run.
    """
    swarm = ProtectedSwarm(30, 0, lambda: 0.0, defence=defence, protocol=protocol)
    addresses = [robot.address for robot in swarm.robots()]
    swarm.drive(addresses[0], 50, 50)
    swarm.set_led(addresses[1], Led(1, 2, 3))
    swarm.follow(addresses[2], [Point(1000.0, 1000.0)], 60.0)
    swarm.step(1.0)
    for address, attack in zip(addresses, swarm.attacks(), strict=False):
        swarm.compromise(address, attack.name)
    for _ in range(round(REHEARSAL_S / PIECE_S)):
        if not wanted():
            return
        swarm.step(PIECE_S)
    if note := _note(defence, protocol):
        note.touch()


async def rehearse_elsewhere(defence: str, protocol: str, tell: Callable[[str], None]) -> None:
    """A process of its own has rehearsed; it ends when we do. `tell` hears how far it is.

    Raises: Unavailable: it failed.
    """
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "phalanx.demo.rehearsal",
        defence,
        protocol,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
        preexec_fn=die_with_parent,
    )
    assert child.stdout is not None, "asked for above"
    try:
        async for line in child.stdout:
            tell(line.decode().strip())
        _, said = await child.communicate()
    finally:
        if child.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
            await child.communicate()
    if child.returncode:
        last = said.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {child.returncode}"]
        raise Unavailable(f"what robots run cannot be compiled: {last[0]}", "phalanx up --defence none does without")


async def rehearse_here(defence: str, protocol: str = "") -> None:
    """This process has rehearsed too, in a thread: with all on disk it takes a second, in which visitors drive on."""
    over = threading.Event()
    try:
        await asyncio.to_thread(rehearse, defence, protocol, lambda: not over.is_set())
    finally:
        over.set()


def _note(defence: str, protocol: str) -> Path | None:
    """The file that says so, beside the kernels and named for what they are made of and by; None where none are.

    Of our sources all count: to rehearse once more with most of it compiled takes seconds.
    """
    run: Any = loop.run
    config: Any = numba.config
    folder = None if config.DISABLE_JIT else kept_in(run)
    if not folder:
        return None
    made_by = (numba.__version__, sys.version, llvmlite.binding.get_host_cpu_name())
    made_of = hashlib.sha256(repr(made_by).encode())
    for source in sorted(Path(phalanx.__file__).parent.rglob("*.py")):
        made_of.update(source.read_bytes())
    return folder / f"rehearsed-{defence}-{protocol}{made_of.hexdigest()[:16]}"


def _say(_: str, share: float) -> None:
    print(f"{100 * share:.0f} % compiled", flush=True)  # noqa: T201 - to whoever started us


if __name__ == "__main__":
    os.nice(NICE)
    with telling_of_compiling(_say):
        rehearse(sys.argv[1], sys.argv[2])
