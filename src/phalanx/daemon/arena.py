"""A world for processes: bodies and a radio in real time, for daemons with trusted processes of their own.

Motors obey the trusted processes alone: a daemon that was taken over, or killed, cannot move its robot past them.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import os
import random
import signal
import socket
import sys
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.io.children import die_with_parent
from phalanx.io.keyring import Keys, pem
from phalanx.io.mission_key import issued
from phalanx.io.ports import LOOPBACK
from phalanx.io.private_file import write_private
from phalanx.sim.audited.setup import POWER_UP_MS, limits_of
from phalanx.sim.scenarios.file import written_scenario
from phalanx.sim.scenarios.scenario import Scenario, for_robots
from phalanx.sim.scenarios.starts import WHEELS
from phalanx.wire.table import BOARD

from .driver import GO, PACKET_BYTES, READY, sense_path, wheels_path
from .ether import Ether, Weather
from .field import Field
from .rehearsal import rehearse
from .run import run_robot
from .settings import RobotSettings, read_robot
from .state import told
from .trusted import program

if TYPE_CHECKING:
    from phalanx.sim.scenarios.recording import Recording

log = logging.getLogger(__name__)

TURN_S = 0.05
READY_TIMEOUT_S = 120.0
END_TIMEOUT_S = 5.0
LAST_ANSWERS_S = 0.2
MOST_ROBOTS = 64
NICER = -10
STATION = {"gateway": "orders", "operator": "stops"}  # what each signs
OnStep = Callable[[Field], None]


@dataclass(slots=True)
class Places:
    """What an arena has laid out for its robots, robots in the order of their ids."""

    scenario: Scenario
    folder: Path
    ports: list[int] = field(default_factory=list)
    robots: list[RobotSettings] = field(default_factory=list)
    sensors: list[socket.socket] = field(default_factory=list)
    wheels: list[socket.socket] = field(default_factory=list)

    def close(self) -> None:
        """Nobody can come any more."""
        for each in (*self.sensors, *self.wheels):
            each.close()


def lay_out(
    scenario: Scenario, folder: Path, air_port: int, ports: list[int], clocks: list[tuple[int, int]], keys: Keys
) -> Places:
    """Keys, a file for each robot, and the sockets of its body, in the folder; for a gateway too, if it has a port.

    Raises: Unavailable: no room there.
    """
    today, air = time.strftime("%Y-%m-%d"), f"{LOOPBACK}:{air_port}"
    places = Places(scenario, folder, ports)
    write_private(folder / "mission.yaml", json.dumps(written_scenario(scenario), indent=1).encode())
    ids = range(1, scenario.robots + 1)
    for rob_id in ids:
        board = BOARD.encode(id=rob_id, master=keys.provision(rob_id, today))
        write_private(folder / f"board-{rob_id}.bin", board)
        places.sensors.append(_listens(sense_path(folder, rob_id)))
        places.wheels.append(_listens(wheels_path(folder, rob_id)))
    write_private(folder / "key.json", issued(*keys.issue(), {}))
    for rob_id, port, (ppm, ahead_ms) in zip(ids, ports, clocks, strict=False):
        said = {
            "robot": rob_id,
            "mission": "mission.yaml",
            "key": "key.json",
            "board": f"board-{rob_id}.bin",
            "trusted": f"process:trusted-{rob_id}.flash",
            "wheels": wheels_path(Path(), rob_id).name,
            "clock_ppm": ppm,
            "clock_ahead_ms": ahead_ms,
            "driver": "arena:.",
            "radio": {"here": f"{LOOPBACK}:{port}", "peers": [air]},
        }
        path = folder / f"robot-{rob_id}.yaml"
        write_private(path, json.dumps(said, indent=1).encode())
        places.robots.append(read_robot(path))
    if len(ports) > scenario.robots:
        here, at = f"{LOOPBACK}:{ports[-1]}", [{"robot": rob_id, "at": air} for rob_id in ids]
        said = {"mission": "mission.yaml", "key": "key.json", "here": here, "robots": at}
        for role, who in STATION.items():
            write_private(folder / f"{role}.pem", pem(keys.signer(who)))
            said[role] = f"{role}.pem"
        write_private(folder / "swarm.yaml", json.dumps(said, indent=1).encode())
    return places


def _listens(path: Path) -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        made.bind(str(path))
    except OSError as error:
        made.close()
        why = error.strerror or error
        raise Unavailable(f"cannot listen at {path}: {why}", "another folder, of a short name") from error
    made.listen(4)
    made.setblocking(False)
    return made


def free_ports(n: int) -> list[int]:
    """So many UDP ports of this machine's that are free just now."""
    with contextlib.ExitStack() as stack:
        made = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(n)]
        for each in made:
            each.bind((LOOPBACK, 0))
        return [int(each.getsockname()[1]) for each in made]


class Arena:
    """The world's side of it: answers sensors, moves bodies, carries frames, hears what robots tell of themselves.

    Attributes:
        field: the bodies.
    """

    def __init__(self, scenario: Scenario, folder: Path, weather: Weather) -> None:
        keys = Keys.new("arena")
        if scenario.controller == WHEELS:
            gateway, operator = (keys.public(who) for who in STATION.values())
            scenario = replace(scenario, gateway_key=gateway, operator_key=operator)
        self.field = Field(scenario)
        self._weather, dice = weather, random.Random(scenario.seed)  # noqa: S311 - weather
        clocks = [
            (dice.randint(-weather.clock_ppm, weather.clock_ppm), dice.randint(1, POWER_UP_MS))
            for _ in range(scenario.robots)
        ]
        # One more for a gateway, if there is somebody to obey it.
        ports = free_ports(scenario.robots + (scenario.controller == WHEELS))
        self._ether = Ether(
            self.field.world,
            scenario.radio,
            weather,
            ports,
            lambda i: i < scenario.robots and bool(self.field.world.safe[i]),
            dice,
        )
        self.places = lay_out(scenario, folder, self._ether.port, ports, clocks, keys)
        self._ready = 0
        self._all_ready = asyncio.Event()
        self._began_s = 0.0
        self._over = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, on_step: OnStep, recording: Recording | None, robots: Robots) -> None:
        """From the moment when all robots are ready to the scenario's end; then they are told to end.

        Raises: Unavailable: a robot does not become ready.
        """
        loop, n = asyncio.get_running_loop(), self.field.scenario.robots
        for i in range(n):
            self._spawn(self._sensors(i))
            self._spawn(self._motors(i))
        self._spawn(self._ether.carry())
        try:
            until_s = loop.time() + READY_TIMEOUT_S
            while not self._all_ready.is_set():
                if robots.ended() or loop.time() > until_s:
                    raise Unavailable(f"{self._ready} of {n} robots became ready", "what one said is above")
                await asyncio.sleep(TURN_S)
            duration_s, next_look_s = self.field.scenario.duration_s, 0.0
            while (now_s := loop.time() - self._began_s) < duration_s:
                if self._weather.cut and now_s >= self._weather.cut_at_s:
                    self.field.cut(self._weather.cut)
                self.field.advance(now_s)
                if now_s >= next_look_s:
                    next_look_s += 1.0
                    self.look()
                    on_step(self.field)
                if recording:
                    recording.write(self.field, [])
                await asyncio.sleep(TURN_S)
            self.field.advance(duration_s)
            self.look()
            on_step(self.field)
            self._over = True
            robots.end()
            await asyncio.sleep(LAST_ANSWERS_S)
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def close(self) -> None:
        """Nobody can come any more."""
        self._ether.close()
        self.places.close()

    def _spawn(self, job: Coroutine[None, None, None]) -> None:
        self._tasks.add(asyncio.ensure_future(job))

    def look(self) -> None:
        """What robots have told of themselves is known."""
        for i, settings in enumerate(self.places.robots):
            with contextlib.suppress(UsageError):  # it has told nothing yet
                state = told(settings.state_file)
                self.field.hear_of(i, state, state["began_monotonic_s"] - self._began_s)

    @property
    def _now_s(self) -> float:
        return asyncio.get_running_loop().time() - self._began_s if self._began_s else 0.0

    async def _sensors(self, i: int) -> None:
        """One robot's daemon after the other reads its body's sensors."""
        loop = asyncio.get_running_loop()
        while True:
            link, _ = await loop.sock_accept(self.places.sensors[i])
            with link:
                while words := await _packet(link):
                    if words == READY:
                        await self._wait_for_all()
                        answer = GO
                    else:
                        self._catch_up()
                        answer = self.field.sensed(i, int.from_bytes(words[:8], "little"))
                    with contextlib.suppress(OSError):
                        await loop.sock_sendall(link, answer)

    async def _wait_for_all(self) -> None:
        self._ready += 1
        if self._ready == self.field.scenario.robots:
            self._began_s = asyncio.get_running_loop().time()
            self._all_ready.set()
        await self._all_ready.wait()

    async def _motors(self, i: int) -> None:
        """One robot's trusted process after the other drives its body, which stands still when that ends."""
        loop = asyncio.get_running_loop()
        while True:
            link, _ = await loop.sock_accept(self.places.wheels[i])
            with link:
                while command := await _packet(link):
                    self._catch_up()
                    self.field.drive(i, command)
                if not self._over:
                    self._catch_up()
                    self.field.stand(i)

    def _catch_up(self) -> None:
        clock = self.field.world.clock[0]
        clock.now_us = max(int(self._now_s * 1e6), int(clock.now_us))


async def _packet(link: socket.socket) -> bytes:
    """The next packet; b"" when nobody is there any more."""
    link.setblocking(False)
    try:
        return await asyncio.get_running_loop().sock_recv(link, PACKET_BYTES)
    except OSError:
        return b""


# --- robots as processes ----------------------------------------------------------------------------------------------


class Robots:
    """A process for each robot of an arena; all are gone when the context is left.

    They are forked, so that what runs is compiled and in memory once: nothing else of this process may have threads.
    """

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._living: list[int] = []

    def __enter__(self) -> Self:
        self._living = [_forked(each, self._arena) for each in self._arena.places.robots]
        return self

    def end(self) -> None:
        """They are told to end."""
        for pid in self._living:
            os.kill(pid, signal.SIGTERM)  # it is ours until `ended` has seen it

    def ended(self) -> bool:
        """Whether one of them has ended."""
        before = len(self._living)
        self._living = [pid for pid in self._living if not os.waitpid(pid, os.WNOHANG)[0]]
        return len(self._living) < before

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.end()
        until_s = time.monotonic() + END_TIMEOUT_S
        while self._living:
            if time.monotonic() > until_s:
                for pid in self._living:
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.01)
            self.ended()


def _forked(settings: RobotSettings, arena: Arena) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()  # Ctrl-C is for the arena
        arena.close()
        die_with_parent()
        if os.getppid() == parent:
            asyncio.run(_until_told(settings))
        code = 0
    except PhalanxError as error:
        sys.stderr.write(f"phalanx: error: robot {settings.said.robot}: {error}\n")
    except BaseException as error:  # noqa: BLE001 - nothing of a child may go on in the parent's place
        sys.stderr.write(f"phalanx: error: robot {settings.said.robot}: {type(error).__name__}: {error}\n")
    finally:
        sys.stderr.flush()
        os._exit(code)


async def _until_told(settings: RobotSettings) -> None:
    job = asyncio.ensure_future(run_robot(settings, rehearsed=True))
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, job.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await job


def _check(scenario: Scenario, weather: Weather) -> None:
    """What no arena plays is said before anything is compiled. Raises: UsageError."""
    for_robots(scenario)
    if scenario.robots > MOST_ROBOTS:
        raise UsageError(f"{scenario.robots} robots", f"at most {MOST_ROBOTS}: each is two processes")
    if scenario.defence != "bound":
        raise UsageError(f"defence is {scenario.defence}", "bound: processes have no other nodes")
    if any(spec.own for spec in scenario.attacks):
        raise UsageError("an attack of your own, in an arena", "one of the library: phalanx attack list")
    if weather.cut >= scenario.robots:
        raise UsageError(f"a cut behind robot {weather.cut}, of {scenario.robots}", "fewer: somebody is to be left")


def play_in_arena(
    scenario: Scenario, folder: Path, weather: Weather, on_step: OnStep, recording: Recording | None = None
) -> Field:
    """The field, at the end of the scenario's time.

    Raises: UsageError: no program for trusted nodes, an attack that no arena plays; Unavailable.
    """
    _check(scenario, weather)
    program()
    with contextlib.suppress(PermissionError):
        os.nice(NICER)  # a processor that others keep busy would make robots late, and liars of them
    rehearse(scenario, limits_of(scenario.bti, scenario.radio))
    gc.collect()
    gc.freeze()  # nor is what all share looked through by each
    arena = Arena(scenario, folder, weather)
    log.warning("trusted nodes are processes, which protect from nobody here")
    try:
        # Before there is an event loop: a child has its own.
        with Robots(arena) as robots:
            asyncio.run(arena.run(on_step, recording, robots))
        arena.look()
    finally:
        arena.close()
    return arena.field
