"""Simulated world for robots that are processes: bodies and a radio, in real time or slower.

A body's motors obey only its robot's trusted process: a daemon that is compromised or killed cannot move the robot.
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
from phalanx.daemon.state import read_state
from phalanx.daemon.trusted import program
from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.net.children import die_with_parent
from phalanx.net.keyring import Keys
from phalanx.robot.planner import ToGoal
from phalanx.scenarios.behaviour import planner_factory
from phalanx.scenarios.own import find_planner, mistakes_in
from phalanx.scenarios.scenario import WHEELS, Scenario, for_robots
from phalanx.world.audited.setup import POWER_UP_MS

from .ether import ArenaRadio, RadioConditions
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
    """Server of the simulated bodies and radio: answers sensor requests, moves bodies, carries packets."""

    def __init__(self, scenario: Scenario, folder: Path, weather: RadioConditions, changes: Changes) -> None:
        keys = Keys.new("arena")
        if scenario.controller == WHEELS:
            gateway, operator = (keys.public(name) for name in STATION.values())
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
        # One more for a gateway, if the robots obey one.
        ports = free_ports(scenario.robots + (scenario.controller == WHEELS))
        self._ether = ArenaRadio(
            self.field.world,
            scenario.radio,
            weather,
            ports,
            self._is_silent,
            dice,
        )
        # A user's own attacks cannot be written to files: the daemons get them when they are forked.
        in_files = tuple(each for each in scenario.drawn_attacks() if not each.own)
        file_scenario = replace(scenario, attacks=in_files)
        self.places = write_arena_files(
            file_scenario, folder, self._ether.port, ports, clocks, keys, changes, weather.speed
        )
        self._ready = 0
        self._all_ready = asyncio.Event()
        self._began_s = 0.0
        self._over = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, on_step: OnStep, recording: Recording | None, robots: Robots) -> None:
        """Run the scenario once all robots are ready, then end them. Raises: Unavailable: one is not ready in time."""
        loop, n = asyncio.get_running_loop(), self.field.scenario.robots
        for i in range(n):
            self._spawn(self._sensors(i))
            self._spawn(self._motors(i))
        self._spawn(self._ether.carry())
        try:
            until_s = loop.time() + READY_TIMEOUT_S
            while not self._all_ready.is_set():
                if robots.ended() or loop.time() > until_s:
                    raise Unavailable(f"{self._ready} of {n} robots became ready", "see the error messages above")
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
        """Close all sockets."""
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
        self._record(self._read_states())

    async def _poll_states(self) -> None:
        """Read the states once per second, in a thread: a busy disk then delays no sensor reading."""
        while True:
            self._record(await asyncio.to_thread(self._read_states))
            await asyncio.sleep(LOOK_S)

    def _read_states(self) -> dict[int, dict[str, Any]]:
        states = {}
        for i, settings in enumerate(self.places.robots):
            with contextlib.suppress(UsageError):  # no state published yet
                states[i] = read_state(settings.state_file)
        return states

    def _record(self, states: dict[int, dict[str, Any]]) -> None:
        for i, state in states.items():
            self.field.record_state(i, state, (state["began_monotonic_s"] - self._began_s) * self._weather.speed)

    def _is_silent(self, i: int) -> bool:
        """Return whether radio i is off. One under attack ignores its a-node, and a gateway's radio is always on."""
        is_robot = i < self.field.scenario.robots
        return is_robot and bool(self.field.world.safe[i]) and i + 1 not in self.on_air

    @property
    def _now_s(self) -> float:
        """Return the field's time since all robots were ready, at most the scenario's duration."""
        passed_s = asyncio.get_running_loop().time() - self._began_s if self._began_s else 0.0
        return min(passed_s * self._weather.speed, self.field.scenario.duration_s)

    async def _sensors(self, i: int) -> None:
        """Serve sensor readings of one body to its robot's daemon, and to the next daemon after a restart."""
        loop = asyncio.get_running_loop()
        while True:
            link, _ = await loop.sock_accept(self.places.sensors[i])
            with link:
                while request := await _packet(link):
                    if request == READY:
                        await self._wait_for_all()
                        answer = GO
                    else:
                        self._catch_up()
                        answer = self.field.sensed(i, int(request))
                    with contextlib.suppress(OSError):
                        await loop.sock_sendall(link, answer)

    async def _wait_for_all(self) -> None:
        self._ready += 1
        if self._ready == self.field.scenario.robots:
            self._began_s = asyncio.get_running_loop().time()
            self._all_ready.set()
        await self._all_ready.wait()

    async def _motors(self, i: int) -> None:
        """Pass commands of one robot's trusted process to its body; stop the body when the process ends."""
        loop = asyncio.get_running_loop()
        while True:
            link, _ = await loop.sock_accept(self.places.wheels[i])
            with link:
                while command := await _packet(link):
                    self._catch_up()
                    self.field.drive(i, command)
                if not self._over:
                    self._catch_up()
                    self.field.halt_motors(i)

    def _catch_up(self) -> None:
        clock = self.field.world.clock[0]
        clock.now_us = max(int(self._now_s * 1e6), int(clock.now_us))


async def _packet(link: socket.socket) -> bytes:
    """Receive the next packet; return b"" when the peer has closed."""
    link.setblocking(False)
    try:
        return await asyncio.get_running_loop().sock_recv(link, PACKET_BYTES)
    except OSError:
        return b""


# --- robots as processes ----------------------------------------------------------------------------------------------


class Robots:
    """Processes of an arena's robots, as a context manager; `failed` has the cause by robot for early ends.

    The processes are forked to share code and data in memory, so this process must have no other threads.
    """

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._running: dict[int, int] = {}  # pid: robot
        self.failed: dict[int, str] = {}

    def __enter__(self) -> Self:
        self._running = {_fork(each, self._arena): each.said.robot for each in self._arena.places.robots}
        return self

    def end(self) -> None:
        """Ask all processes to end."""
        for pid in self._running:
            os.kill(pid, signal.SIGTERM)  # the pid stays ours until `ended` reaps it

    def ended(self) -> bool:
        """Reap ended processes, and return whether there were any."""
        gone = {pid: status for pid in self._running for found, status in [os.waitpid(pid, os.WNOHANG)] if found}
        for pid, status in gone.items():
            self.failed[self._running.pop(pid)] = _how_ended(os.waitstatus_to_exitcode(status))
        return bool(gone)

    def __exit__(self, *_error: object) -> None:
        self.end()
        until_s = time.monotonic() + END_TIMEOUT_S
        while self._running:
            if time.monotonic() > until_s:
                for pid in self._running:
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.01)
            self.ended()


def _how_ended(code: int) -> str:
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return "ended with an error, see above" if code else "ended on request"


def _fork(settings: RobotSettings, arena: Arena) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()  # Ctrl-C goes to the arena only
        arena.close()
        die_with_parent()
        if os.getppid() == parent:
            changes = arena.changes
            with mistakes_in(changes.controller, changes.planner, *changes.attacks):
                asyncio.run(_wait_for_end(settings, arena))
        code = 0
    except PhalanxError as error:
        sys.stderr.write(f"phalanx: error: robot {settings.said.robot}: {error}\n")
    except BaseException as error:  # noqa: BLE001 - a child must never return into the parent's code
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
    """Check that an arena can play the scenario. Raises: UsageError."""
    for_robots(scenario)
    if scenario.robots > MOST_ROBOTS:
        raise UsageError(f"{scenario.robots} robots", f"use at most {MOST_ROBOTS}: each robot needs two processes")
    if scenario.defence != "hardened":
        raise UsageError(f"defence is {scenario.defence}", "use hardened: robot processes have no other trusted nodes")
    if weather.speed < 1 and scenario.controller == WHEELS:
        raise UsageError("an arena slower than real time with a gateway", "use speed 1: a gateway's clock is real time")
    if weather.cut >= scenario.robots:
        raise UsageError(f"a cut after robot {weather.cut} of {scenario.robots}", "use less: both sides need robots")


def _set_realtime_priority() -> None:
    """Request real-time priority: on a busy processor honest robots would answer late and look compromised."""
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
    """Run the scenario, and return the field at its end. Raises: UsageError: it cannot be played; Unavailable."""
    _check(scenario, weather)
    scenario = with_room_for_seals(scenario) if changes.sealed else scenario
    planner = None if is_far(changes.planner) else find_planner(changes.planner or None)
    if planner_factory(scenario, changes.make, ToGoal if is_far(changes.planner) else planner):
        check_adviser(scenario, is_far=is_far(changes.planner))
    program()
    arena = Arena(scenario, folder, weather, changes)
    log.warning("trusted nodes run as processes of this user: no protection against an attacker on this machine")
    try:
        _set_realtime_priority()
        gc.collect()
        gc.freeze()  # keeps the children's collectors from copying shared memory
        # Before the event loop starts: each child runs its own.
        with Robots(arena) as robots:
            asyncio.run(arena.run(on_step, recording, robots))
        arena.look()
    finally:
        arena.close()
    return arena.field
