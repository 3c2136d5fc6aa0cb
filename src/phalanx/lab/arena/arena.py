"""A world for processes: bodies and a radio in real time or slower, for daemons with trusted processes of their own.

Motors obey the trusted processes alone: a daemon that was taken over, or killed, cannot move its robot past them.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import random
import signal
import socket
import sys
import time
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from phalanx.daemon.driver import GO, PACKET_BYTES, READY
from phalanx.daemon.far_planner import check_adviser, is_far
from phalanx.daemon.run import run_robot
from phalanx.daemon.sealed_air import with_room_for_seals
from phalanx.daemon.settings import RobotSettings
from phalanx.daemon.state import told
from phalanx.daemon.trusted import program
from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.net.children import die_with_parent
from phalanx.net.keyring import Keys
from phalanx.robot.planner import ToGoal
from phalanx.scenarios.behaviour import adviser
from phalanx.scenarios.own import find_planner, mistakes_in
from phalanx.scenarios.scenario import WHEELS, Scenario, for_robots
from phalanx.world.audited.setup import POWER_UP_MS

from .ether import RadioConditions, SimulatedAir
from .field import Field
from .places import STATION, Changes, free_ports, write_arena_files

if TYPE_CHECKING:
    from phalanx.world.scenarios.recording import Recording

log = logging.getLogger(__name__)

TURN_S, LOOK_S = 0.05, 1.0
READY_TIMEOUT_S = 120.0
END_TIMEOUT_S = 5.0
LAST_ANSWERS_S = 0.2
MOST_ROBOTS = 64
NICER = -10
OnStep = Callable[[Field], None]


class Arena:
    """Answers sensors, moves the bodies in `field`, carries packets, and reads what robots tell of themselves."""

    def __init__(self, scenario: Scenario, folder: Path, weather: RadioConditions, changes: Changes) -> None:
        keys = Keys.new("arena")
        if scenario.controller == WHEELS:
            gateway, operator = (keys.public(who) for who in STATION.values())
            scenario = replace(scenario, gateway_key=gateway, operator_key=operator)
        hostile = {each.robot: each.name for each in changes.on_air}
        self.field = Field(scenario, getattr(changes.make, "senses", None), hostile)
        self.changes = changes
        self.on_air = {each.robot: each for each in changes.on_air}
        self._weather, dice = weather, random.Random(scenario.seed)  # noqa: S311 - weather
        clocks = [
            (dice.randint(-weather.clock_ppm, weather.clock_ppm), dice.randint(1, POWER_UP_MS))
            for _ in range(scenario.robots)
        ]
        # One more for a gateway, if there is somebody to obey it.
        ports = free_ports(scenario.robots + (scenario.controller == WHEELS))
        self._ether = SimulatedAir(
            self.field.world,
            scenario.radio,
            weather,
            ports,
            self._is_silent,
            dice,
        )
        # Of one's own attacks no file can tell: daemons are given them as they are forked.
        told = tuple(each for each in scenario.drawn_attacks() if not each.own)
        told_scenario = replace(scenario, attacks=told)
        self.places = write_arena_files(
            told_scenario, folder, self._ether.port, ports, clocks, keys, changes, weather.speed
        )
        self._ready = 0
        self._all_ready = asyncio.Event()
        self._began_s = 0.0
        self._over = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, on_step: OnStep, recording: Recording | None, robots: Robots) -> None:
        """Run the scenario once all robots are ready, then end them. Raises: Unavailable: one does not get ready."""
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
            self._spawn(self._poll_states())
            duration_s, next_step_s = self.field.scenario.duration_s, 0.0
            while (now_s := self._now_s) < duration_s:
                if self._weather.cut and now_s >= self._weather.cut_at_s:
                    self.field.cut(self._weather.cut)
                self.field.advance(now_s)
                if now_s >= next_step_s:
                    next_step_s += 1.0
                    self._step(robots, now_s, on_step)
                if recording:
                    recording.write(self.field, [])
                await asyncio.sleep(TURN_S)
            self.field.advance(duration_s)
            self.look()
            self._step(robots, duration_s, on_step)
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

    def _step(self, robots: Robots, now_s: float, on_step: OnStep) -> None:
        robots.ended()
        for rob_id, how in robots.failed.items():
            self.field.fail(rob_id, how, now_s)
        on_step(self.field)

    def _spawn(self, job: Coroutine[None, None, None]) -> None:
        self._tasks.add(asyncio.ensure_future(job))

    def look(self) -> None:
        """Read the state that each robot has published."""
        self._hear(self._said())

    async def _poll_states(self) -> None:
        """The same, each second: a disk that is busy holds up a thread, and no robot's sensors."""
        while True:
            self._hear(await asyncio.to_thread(self._said))
            await asyncio.sleep(LOOK_S)

    def _said(self) -> dict[int, dict[str, Any]]:
        said = {}
        for i, settings in enumerate(self.places.robots):
            with contextlib.suppress(UsageError):  # it has told nothing yet
                said[i] = told(settings.state_file)
        return said

    def _hear(self, said: dict[int, dict[str, Any]]) -> None:
        for i, state in said.items():
            self.field.record_state(i, state, (state["began_monotonic_s"] - self._began_s) * self._weather.speed)

    def _is_silent(self, i: int) -> bool:
        """Return whether radio i is off; one that is taken over obeys no a-node, and a gateway's has none."""
        is_robot = i < self.field.scenario.robots
        return is_robot and bool(self.field.world.safe[i]) and i + 1 not in self.on_air

    @property
    def _now_s(self) -> float:
        """Of the field, since all were ready; robots that are still asked after its end find it as it was."""
        passed_s = asyncio.get_running_loop().time() - self._began_s if self._began_s else 0.0
        return min(passed_s * self._weather.speed, self.field.scenario.duration_s)

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
                        answer = self.field.sensed(i, int(words))
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
    """Runs a process for each robot of an arena, as a context; `failed` says how one ended before it was told to.

    They are forked, so that code and data are in memory once: nothing else of this process may have threads.
    """

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._living: dict[int, int] = {}  # the robot of each process
        self.failed: dict[int, str] = {}

    def __enter__(self) -> Self:
        self._living = {_forked(each, self._arena): each.said.robot for each in self._arena.places.robots}
        return self

    def end(self) -> None:
        """They are told to end."""
        for pid in self._living:
            os.kill(pid, signal.SIGTERM)  # it is ours until `ended` has seen it

    def ended(self) -> bool:
        """Return whether one of them has ended."""
        gone = {pid: status for pid in self._living for found, status in [os.waitpid(pid, os.WNOHANG)] if found}
        for pid, status in gone.items():
            self.failed[self._living.pop(pid)] = _how_ended(os.waitstatus_to_exitcode(status))
        return bool(gone)

    def __exit__(self, *_error: object) -> None:
        self.end()
        until_s = time.monotonic() + END_TIMEOUT_S
        while self._living:
            if time.monotonic() > until_s:
                for pid in self._living:
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.01)
            self.ended()


def _how_ended(code: int) -> str:
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return "ended by a mistake, told above" if code else "ended, as somebody told it to"


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
            changes = arena.changes
            with mistakes_in(changes.controller, changes.planner, *changes.attacks):
                asyncio.run(_wait_for_end(settings, arena))
        code = 0
    except PhalanxError as error:
        sys.stderr.write(f"phalanx: error: robot {settings.said.robot}: {error}\n")
    except BaseException as error:  # noqa: BLE001 - nothing of a child may go on in the parent's place
        sys.stderr.write(f"phalanx: error: robot {settings.said.robot}: {type(error).__name__}: {error}\n")
    finally:
        sys.stderr.flush()
        os._exit(code)


async def _wait_for_end(settings: RobotSettings, arena: Arena) -> None:
    on_air, attacks = arena.on_air.get(settings.said.robot), arena.field.scenario.drawn_attacks()
    job = asyncio.ensure_future(run_robot(settings, in_arena=True, on_air=on_air, attacks=attacks))
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, job.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await job


def _check(scenario: Scenario, weather: RadioConditions) -> None:
    """Refuse what no arena plays. Raises: UsageError."""
    for_robots(scenario)
    if scenario.robots > MOST_ROBOTS:
        raise UsageError(f"{scenario.robots} robots", f"at most {MOST_ROBOTS}: each is two processes")
    if scenario.defence != "hardened":
        raise UsageError(f"defence is {scenario.defence}", "hardened: processes have no other nodes")
    if weather.speed < 1 and scenario.controller == WHEELS:
        raise UsageError("an arena slower than real time, for robots that obey orders", "their gateway's clock is true")
    if weather.cut >= scenario.robots:
        raise UsageError(f"a cut behind robot {weather.cut}, of {scenario.robots}", "fewer: somebody is to be left")


def _set_realtime_priority() -> None:
    """Ask for real-time priority: on a busy processor honest robots would be late and look compromised."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))
    except PermissionError:
        with contextlib.suppress(PermissionError):
            os.nice(NICER)


def play_in_arena(
    scenario: Scenario,
    folder: Path,
    weather: RadioConditions,
    on_step: OnStep,
    recording: Recording | None,
    changes: Changes,
) -> Field:
    """Return the field at the scenario's end. Raises: UsageError: no nodes, or it cannot be played; Unavailable."""
    _check(scenario, weather)
    scenario = with_room_for_seals(scenario) if changes.sealed else scenario
    planner = None if is_far(changes.planner) else find_planner(changes.planner or None)
    if adviser(scenario, changes.make, ToGoal if is_far(changes.planner) else planner):
        check_adviser(scenario, is_far=is_far(changes.planner))
    program()
    arena = Arena(scenario, folder, weather, changes)
    log.warning("trusted nodes are processes, which protect from nobody here")
    try:
        _set_realtime_priority()
        gc.collect()
        gc.freeze()  # nor is what all share looked through by each
        # Before there is an event loop: a child has its own.
        with Robots(arena) as robots:
            asyncio.run(arena.run(on_step, recording, robots))
        arena.look()
    finally:
        arena.close()
    return arena.field
