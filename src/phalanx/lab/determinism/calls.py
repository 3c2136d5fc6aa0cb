"""Calls to test a controller with: those of a simulated run, then malformed packets, advice and sensor readings.

During a call the controller must not loop forever, sleep, start a thread or open a file; `watch_call` detects that.
"""

from __future__ import annotations

import contextlib
import inspect
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.config import BtiConfig
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.dispatch import BUNDLED, NUMBERS
from phalanx.robot.controllers.protocol import find_protocol
from phalanx.robot.controllers.python_controller import Controller, Output, OwnMistake, checked_outputs, overridden
from phalanx.robot.planner import Planner, ToGoal, advice_of
from phalanx.robot.signer import Signer
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_own, is_file, no_controller
from phalanx.scenarios.scenario import PROTOCOLS, Scenario
from phalanx.wire import driven, table
from phalanx.wire.fields import put_u16, put_u64
from phalanx.world.scenarios.run import Run
from phalanx.world.signals import handled_by

Make = Callable[[int], Controller]
ROBOTS, ROBOT, LIFE_S, GOAL_M = 9, 5, 15.0, (120.0, 120.0)
CONTROL_MS = 250
LATEST_MS = (1 << 32) - 1  # largest time that a log entry can hold
LONGEST_BYTES = 400
# Floats as encoded in packets and readings: NaN of either sign, infinities, largest, smallest, -0.
ODD = tuple(np.array(bits, "<u4").tobytes() for bits in (0x7FC00000, 0xFFC00001, 0x7F800000, 0xFF800000)) + tuple(
    np.array(value, "<f4").tobytes() for value in (3.4e38, -3.4e38, 1e-45, -0.0)
)
# Offsets common to all packets and readings.
ID_AT, T_AT, NUMBERS_AT = table.SENSOR.at("id"), table.SENSOR.at("t"), table.SENSOR.at("x_m")
FRAMES_A_READING = 3
FRAME, ADVICE = -1, -2
LONGEST_CALL_S = 10.0  # processor time; three times as much wall-clock time
# Python audit events and the descriptions for findings.
FORBIDDEN = {
    "open": "opens a file",
    "os.listdir": "reads a folder",
    "os.scandir": "reads a folder",
    "os.system": "starts a program",
    "subprocess.Popen": "starts a program",
    "os.fork": "starts a process",
    "socket.__new__": "opens a socket",
}
# Code in these modules is exempt: imports may happen during a call.
ALLOWED = "importlib"

# Actions without an audit event.
WRAPPED: tuple[tuple[Any, str, str], ...] = ((time, "sleep", "sleeps"), (threading.Thread, "start", "starts a thread"))

_calls: list[list[str]] = []  # findings of each watched call


@dataclass(frozen=True, slots=True)
class Call:
    """A call of the controller with a received packet, advice, or a sensor reading."""

    step: int  # number of the reading, from 0; FRAME or ADVICE for the others
    t_ms: int  # time of the trusted node
    payload: bytes
    odd: str = ""  # description of the defect; "" for a regular call

    @property
    def method(self) -> str:
        """Return the name of the controller's method to call."""
        return "on_input" if self.step >= 0 else {FRAME: "on_recv", ADVICE: "on_advice"}[self.step]

    def __str__(self) -> str:
        label = f"reading {self.step}" if self.step >= 0 else {FRAME: "packet", ADVICE: "advice"}[self.step]
        return f"{label}, {self.t_ms} ms" + (f", {self.odd}" if self.odd else "")


def controller_factory(name: str) -> Make:
    """Return a factory for the bundled controller of that name, or for "FILE.py:CLASS" or "FILE.py".

    Raises: as `find_class`. UsageError: no such name.
    """
    if is_file(name) and (own := find_own(name)):
        return own
    if name in BUNDLED:
        keys = {"gateway_key": _gateway().public} if _is_driven(name) else {}
        return compiled(NUMBERS[name], BUNDLED[name].params(BUNDLED[name].config(**keys)))
    if protocol := find_protocol(name):
        return protocol.maker(find_scenario(name).task)
    raise no_controller(name, [*BUNDLED, *PROTOCOLS])


def calls_of(make: Make, name: str, seed: int) -> list[Call]:
    """Return the calls that robot 5 of nine receives in 15 s, followed by malformed ones.

    Raises: whatever the controller raises in a world without compromised robots.
    """
    chance = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0xC4EC])))
    is_advised = _is_advised(make, name)
    life = list(_driven(chance)) if _is_driven(name) else _calls_in_run(make, _world_of(name, seed), is_advised)
    return [*life, *_odd(life, chance)]


def _is_advised(make: Make, name: str) -> bool:
    """Return whether the controller uses a planner's advice."""
    if name in BUNDLED:
        return BUNDLED[name].advised is not None
    return type(make(ROBOT)).on_advice is not Controller.on_advice


def _is_driven(name: str) -> bool:
    return name in BUNDLED and BUNDLED[name].reads is table.WHEELS_SENSOR


def _gateway() -> Signer:
    """Return a signer with a public test key, which no real robot accepts."""
    return Signer(Ed25519PrivateKey.from_private_bytes(bytes(driven.SIGNER_KEY_BYTES)), 1, driven.GATEWAY)


class _Recorder(Controller):
    """Controller that forwards all calls to another one and records them."""

    def __init__(self, rob_id: int, make: Make, calls: list[Call], planner: Planner | None) -> None:
        super().__init__(rob_id)
        self._inner, self._calls, self._planner = make(rob_id), calls, planner

    def encode(self) -> bytes:
        return self._inner.encode()

    def decode(self, encoding: bytes) -> None:
        self._inner.decode(encoding)

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        self._calls.append(Call(FRAME, t_ms, packet))
        with watch_call(self._inner, "on_recv", str(self._calls[-1])):
            self._inner.on_recv(t_ms, packet)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        if self._planner:
            self._calls.append(Call(ADVICE, t_ms, advice_of(self._planner, t_ms, reading)))
            with watch_call(self._inner, "on_advice", str(self._calls[-1])):
                self._inner.on_advice(self._calls[-1].payload)
        self._calls.append(Call(step, t_ms, reading))
        with watch_call(self._inner, "on_input", str(self._calls[-1])):
            outputs = self._inner.on_input(step, t_ms, reading)
        return checked_outputs(outputs, BtiConfig().packet_max_bytes, self._inner)


def _world_of(name: str, seed: int) -> Scenario:
    """Return the protocol's own scenario, if the name is one of the protocols, else a flock of nine."""
    if name in PROTOCOLS:
        return replace(find_scenario(name), duration_s=LIFE_S, defence="none", seed=seed, attacks=())
    # Generous room for a checkpoint: its size is not tested here.
    bti = BtiConfig(f_max=2, state_bytes=4096)
    return Scenario(robots=ROBOTS, goal_m=GOAL_M, duration_s=LIFE_S, defence="none", seed=seed, bti=bti)


def _calls_in_run(make: Make, scenario: Scenario, is_advised: bool) -> list[Call]:
    calls: dict[int, list[Call]] = {rob_id: [] for rob_id in range(1, scenario.robots + 1)}
    planner = partial(ToGoal, goal_m=scenario.goal_m) if is_advised else lambda _: None

    def recorder(rob_id: int) -> _Recorder:
        return _Recorder(rob_id, make, calls[rob_id], planner(rob_id))

    recorder.senses = getattr(make, "senses", None)  # type: ignore[attr-defined]
    run = Run(scenario, recorder)
    run.advance(LIFE_S)
    return calls[ROBOT]


def _driven(chance: np.random.Generator) -> Iterator[Call]:
    """Yield calls of a driven robot: readings of a random walk, orders to it and others, and broadcasts of others."""
    gateway = _gateway()
    x_mm, y_mm, direction_deg = 500.0, 500.0, 0.0
    for step in range(int(1000 * LIFE_S) // CONTROL_MS):
        t_ms = 1000 + step * CONTROL_MS
        if step % 7 == 3:
            left, right = (int(pct) for pct in chance.integers(-100, 101, 2))
            yield Call(FRAME, t_ms - 20, gateway.wheels(ROBOT, t_ms, left, right))
        if step % 20 == 11:
            way = [(int(x), int(y)) for x, y in chance.integers(0, 2000, (3, 2))]
            yield Call(FRAME, t_ms - 10, gateway.route(ROBOT, t_ms, 60, way))
        pose = {"t": t_ms, "x_mm": x_mm, "y_mm": y_mm, "direction_deg": direction_deg}
        yield Call(FRAME, t_ms - 5, table.WHEELS_STATE.encode(id=ROBOT + 1, **pose, red=0, green=0, blue=0))
        yield Call(step, t_ms, table.WHEELS_SENSOR.encode(id=ROBOT, **pose))
        x_mm += float(chance.normal(0, 20))
        y_mm += float(chance.normal(0, 20))
        direction_deg = (direction_deg + float(chance.normal(0, 10))) % 360


def _odd(life: list[Call], chance: np.random.Generator) -> Iterator[Call]:
    readings = [call for call in life if call.step >= 0]
    received = [call.payload for call in life if call.step == FRAME]
    last, step = life[-1], readings[-1].step
    state = bytes([table.KIND_STATE]) + readings[-1].payload[ID_AT:]  # a compromised robot may broadcast
    usual = {(packet[0], len(packet)): packet for packet in (state, *received)}  # one of each kind and length
    packets = list(_odd_frames(list(usual.values()), chance))
    for k, (t_offset_ms, packet, odd) in enumerate(packets):
        t_ms = min(max(0, last.t_ms + CONTROL_MS * (k // FRAMES_A_READING) + t_offset_ms), LATEST_MS)
        yield Call(FRAME, t_ms, packet, odd)
        if k % FRAMES_A_READING == 0:
            step += 1
            yield _at(readings[-1], step, last.t_ms + CONTROL_MS * (k // FRAMES_A_READING))
    now_ms = last.t_ms + CONTROL_MS * (1 + len(packets) // FRAMES_A_READING)
    advised = [call.payload for call in life if call.step == ADVICE and call.payload]
    for payload, odd in _odd_advice(advised[-1]) if advised else ():
        step, now_ms = step + 1, now_ms + CONTROL_MS
        yield Call(ADVICE, now_ms, payload, odd)
        yield _at(readings[-1], step, now_ms)
    for k, (payload, odd) in enumerate(_odd_readings(readings)):
        yield _at(Call(step, 0, payload, odd), step + 1 + k, now_ms + k * CONTROL_MS)


def _at(call: Call, step: int, t_ms: int) -> Call:
    dated = np.frombuffer(call.payload, np.uint8).copy()
    put_u64(dated, T_AT, t_ms)
    return Call(step, t_ms, dated.tobytes(), call.odd)


def _odd_frames(usual: list[bytes], chance: np.random.Generator) -> Iterator[tuple[int, bytes, str]]:
    """Yield malformed packets: time offset in ms, packet, description of the defect."""
    for packet in usual:
        yield from ((0, packet, "again") for _ in range(3))
        yield from ((off_ms, packet, f"{off_ms:+d} ms out of order") for off_ms in (-5000, 60_000, -(1 << 32), 1 << 32))
        yield from ((0, packet[:n], f"cut to {n} bytes") for n in sorted({0, 1, 3, len(packet) // 2, len(packet) - 1}))
        yield 0, packet + b"\0", "a byte too long"
        yield 0, packet + bytes(max(0, LONGEST_BYTES - len(packet))), f"{LONGEST_BYTES} bytes"
        yield 0, packet[:1] + bytes(len(packet) - 1), "zeros"
        yield 0, packet[:1] + b"\xff" * (len(packet) - 1), "ones"
        for rob_id in (0, ROBOT, *range(1000, 1040)):
            changed = np.frombuffer(packet, np.uint8).copy()
            put_u16(changed, ID_AT, rob_id)
            yield 0, changed.tobytes(), f"from robot {rob_id}"
        for at in range(len(packet) - 4, 2, -4):
            yield from ((0, packet[:at] + odd + packet[at + len(odd) :], f"{odd.hex()} at byte {at}") for odd in ODD)
    for _ in range(20):
        noise = bytearray(chance.bytes(int(chance.integers(1, 64))))
        noise[0] &= ~table.KIND_AUDIT & 0xFF
        yield 0, bytes(noise), "noise"


def _odd_advice(usual: bytes) -> Iterator[tuple[bytes, str]]:
    """Yield malformed advice with a description of the defect."""
    yield usual, "again"
    yield from ((usual[:n], f"cut to {n} bytes") for n in (0, 1, len(usual) // 2, len(usual) - 1))
    yield usual + b"\0", "a byte too long"
    yield bytes(len(usual)), "zeros"
    yield b"\xff" * LONGEST_BYTES, f"{LONGEST_BYTES} bytes"
    for at in range(len(usual) - 4, 0, -4):
        yield from ((usual[:at] + odd + usual[at + 4 :], f"{odd.hex()} at byte {at}") for odd in ODD)


def _odd_readings(readings: list[Call]) -> Iterator[tuple[bytes, str]]:
    """Yield readings of the usual length, which the body guarantees, with arbitrary content."""
    usual = readings[-1].payload
    for at in range(NUMBERS_AT, len(usual) - 3, 4):
        yield from ((usual[:at] + odd + usual[at + 4 :], f"{odd.hex()} at byte {at}") for odd in ODD)
    yield from ((call.payload, "an old one") for call in readings[:3])
    yield from ((usual, "as usual") for _ in range(12))


# --- during a call ---


class Endless(OwnMistake):
    """Raised when a call does not return in time; the check then ends."""


@contextlib.contextmanager
def watch_call(controller: object, method: str, call: str) -> Iterator[None]:
    """Watch a call of `controller` in the body of this context.

    The time is limited only in the main thread.

    Raises: OwnMistake: the controller did something forbidden, even if it caught the error. Endless: no return in time.
    """
    _install_hooks()

    def late(_number: int, frame: FrameType | None) -> None:
        if not _is_allowed(frame):
            what = f"{method} has not returned for {LONGEST_CALL_S:g} s ({call})"
            raise Endless(what, "look for an endless loop or a blocking call", controller, method)

    method = overridden(controller, method)
    seen: list[str] = []
    _calls.append(seen)
    with _timed(late):
        try:
            yield
        except Endless:
            seen.clear()
            raise
        finally:
            _calls.pop()
            if seen:
                raise OwnMistake(f"{method} {seen[0]} ({call})", "use only the call's inputs", controller, method)


@contextlib.contextmanager
def _timed(late: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    timers = {signal.ITIMER_VIRTUAL: LONGEST_CALL_S, signal.ITIMER_REAL: 3 * LONGEST_CALL_S}
    with handled_by(late, signal.SIGVTALRM, signal.SIGALRM) as main:
        for timer, seconds in timers.items() if main else ():
            signal.setitimer(timer, seconds, seconds)
        try:
            yield
        finally:
            for timer in timers if main else ():
                signal.setitimer(timer, 0.0)


@cache
def _install_hooks() -> None:
    """Install the hooks. They cannot be removed, and have no effect while no call is watched."""
    sys.addaudithook(lambda event, _args: _note(FORBIDDEN.get(event)))
    for owner, name, what in WRAPPED:
        does = getattr(owner, name)

        def wrapper(*args: Any, does: Callable[..., Any] = does, what: str = what) -> Any:
            _note(what)
            return does(*args)

        setattr(owner, name, wrapper)


def _note(what: str | None) -> None:
    if what and _calls and not _is_allowed(inspect.currentframe()):
        _calls[-1].append(what)
        raise PermissionError(what)


def _is_allowed(frame: FrameType | None) -> bool:
    while frame:
        if any(part.startswith(ALLOWED) for part in Path(frame.f_code.co_filename.strip("<>")).parts):
            return True
        frame = frame.f_back
    return False
