"""Run one robot in real time from its mission key on: its c-node with trusted nodes, radio and driver.

The handlers are those of the simulator, and robot/runtime.py keeps the timers. A due reading has priority, and packets
are handled one at a time, so an audit delays a reading by its own duration at most. Without a reading the robot logs
one of NaN, stops its motors, and continues its audits.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import time
from collections import deque
from collections.abc import Hashable
from pathlib import Path
from typing import TypeVar

import numpy as np

from phalanx.bti import elsewhere, request
from phalanx.bti.fleet import HARDENED, make_fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import make_work
from phalanx.errors import UsageError
from phalanx.net.udp_radio import Radio
from phalanx.robot.actions import Actuate, Transmit
from phalanx.robot.adversary.liar import Liar, lying
from phalanx.robot.planner import MakePlanner, Planner, ToGoal, advice_of, forward_state
from phalanx.robot.robot import Robot
from phalanx.robot.runtime import Done, Runtime
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.behaviour import MakeController, declaration_of, number_of, params_of, plan_of, planner_factory
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import row

from .driver import Hardware, NoReading, no_reading
from .far_planner import FarPlanner, check_adviser
from .kept_log import KeptLog
from .lateness import Lateness, why_stopped
from .trusted import NodeClock

log = logging.getLogger(__name__)
_Audit = TypeVar("_Audit", bound=Hashable)

# In tenths of δ: how long before a reading's time on the grid the sensors are read; this leaves over δ for delays.
# A robot that waits for advice reads when advice arrives (at most AT_ADVICE early), or at the grid time.
EARLY, AT_ADVICE = 7, 9
# In tenths of δ: how long after that time to wait for sensors; the rest is for the trusted nodes' line.
LATE = 5
ALIVE_S = 0.1  # period of `Hardware.alive`


def memory_kb() -> int:
    """Return the resident memory of this process, kB, shared pages included."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() // 1024


class Life:
    """One robot in real time; its trusted nodes receive their mission key right before `begin`.

    Attributes:
        clock: the clock of its trusted nodes.
        radio: its radio.
        far: a planner in another process, or None.
        longest_ms: the longest time of each activity; `late` is the delay of a reading.
        why_late: the delay of the latest reading, if over δ / 2, and its cause; "" for none.
        waits_for_advice: readings wait for advice, which `advised` announces.
        memory_began_kb: memory of the process when its mission key was loaded.
        began_ms, began_s: when its mission key was loaded, by its nodes' clock and by this machine's monotonic clock.
        why_stopped: why it is in Safe Mode; "" while it is not.
        why_ended: why its process has ended; "" while it has not.
        no_reading: since when there are no readings, by the robot's clock, and why; None while there are.
        given: tokens issued, by auditee: number, and time of the last, ms.
        refused: audits refused, by auditee and refusal: number, and time of the last, ms.
    """

    def __init__(
        self,
        scenario: Scenario,
        rob_id: int,
        clock: NodeClock,
        hardware: Hardware,
        radio: Radio,
        planner: MakePlanner | FarPlanner | None = None,
        controller: MakeController | None = None,
        mission: int = 1,
    ) -> None:
        if scenario.defence != "hardened":
            raise UsageError(f"defence is {scenario.defence}", "use hardened, the only one with boards")
        if rob_id > scenario.robots:
            raise UsageError(f"robot {rob_id} is not in the mission", f"use a robot from 1 to {scenario.robots}")
        self.scenario, self.id, self.mission = scenario, rob_id, mission
        self._reads = declaration_of(scenario).reads
        self.clock, self._hardware, self.radio = clock, hardware, radio
        self._rows = elsewhere.register_remote([clock])
        self.fleet = make_fleet(
            1,
            scenario.bti,
            params_of(scenario, mission),
            profile=HARDENED,
            controller=number_of(scenario, controller),
            mission_seed=scenario.seed,
            snode=self._rows,
            anode=self._rows,
        )
        self.fleet.robot["id"] = rob_id
        self._work = make_work(scenario.bti)
        self._controller = controller
        self.far = planner if isinstance(planner, FarPlanner) else None
        make = planner_factory(scenario, controller, ToGoal if isinstance(planner, FarPlanner) else planner)
        if make:
            check_adviser(scenario, is_far=self.far is not None)
        self._planner: Planner | None = make(rob_id, scenario.goal_m) if make and not self.far else None
        self.attack: AttackSpec | None = next((x for x in scenario.drawn_attacks() if x.robot == rob_id), None)
        if self.attack:
            self.attack.attack.kind.before_key(rob_id, HARDENED, self._rows[0], scenario.bti.f_max)
        self._advised = self.waits_for_advice = False
        self._lateness, self.why_late = Lateness(), ""
        self._packet_or_advice = asyncio.Event()
        self._cpu_s = self.began_s = 0.0
        self.began_ms = self.memory_began_kb = 0
        self.longest_ms = {"late": 0.0, "reading": 0.0, "packet": 0.0, "audit": 0.0, "check": 0.0}
        self.why_stopped = self.why_ended = ""
        self.no_reading: tuple[int, str] | None = None
        self.given: dict[int, tuple[int, int]] = {}
        self.refused: dict[tuple[int, Refusal], tuple[int, int]] = {}
        self.runtime: Runtime | None = None
        self.robot: Robot | Liar | None = None

    def begin(self) -> None:
        """Start, right after the mission key was loaded. Raises: Unavailable: the nodes are gone."""
        now_ms = self.clock.now_ms()
        self.robot = self._make_robot(now_ms)
        self.runtime = Runtime(self.robot, self.scenario.bti, now_ms)
        self.began_ms = now_ms  # stored here, as an attack can change its c-node's own record
        self.memory_began_kb = memory_kb()
        self.began_s, self._cpu_s = time.monotonic(), time.process_time()

    def _make_robot(self, now_ms: int) -> Robot | Liar:
        if self.attack is None:
            return Robot(self.fleet, 0, self._work, self._controller)
        log.warning("robot %d simulates an attack: %s", self.id, self.attack.name)
        chance = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.scenario.seed, self.id])))
        plan = plan_of(self.scenario, self.attack, now_ms, chance)
        return lying(self.attack.attack, self.fleet, 0, self._work, plan, self._controller)

    async def live(self, kept: KeptLog) -> None:
        """Run until cancelled or stopped by the nodes, then stop the motors. Raises: Unavailable: no nodes or arena."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self.radio, self._packet_or_advice.set)
        beats = loop.create_task(self._beat())
        try:
            await self._until_stopped(kept)
        finally:
            self._hardware.stop()
            beats.cancel()
            # Also in Safe Mode: the socket is no longer read, and the system drops packets once its buffer is full.
            loop.remove_reader(self.radio)
        self.why_stopped = why_stopped(self.fleet, self.clock.now_ms(), self.longest_ms["late"])
        log.error("robot %d is in Safe Mode: %s", self.id, self.why_stopped)

    async def _beat(self) -> None:
        while True:
            self._hardware.alive()
            await asyncio.sleep(ALIVE_S)

    async def _until_stopped(self, kept: KeptLog) -> None:
        assert self.runtime
        while not self.runtime.in_safe_mode:
            wait_ms = await self._turn()
            elsewhere.raise_failed()
            kept.keep(self.fleet)
            self._packet_or_advice.clear()
            if wait_ms <= 0:
                await asyncio.sleep(0)  # let the loop read received packets
                continue
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_ms / 1000 / self.clock.speed):
                    await self._packet_or_advice.wait()

    def advised(self) -> None:
        """Note new advice: the next reading may be as early as auditors allow."""
        self._advised = True
        self._packet_or_advice.set()

    async def _turn(self) -> float:
        """Handle the most urgent due event, or one packet. Return 0, or ms until the next event if none was due."""
        runtime, now_ms = self.runtime, self.clock.now_ms()
        assert runtime
        self._lateness.turn(self.clock.asked_ms)
        began_s, input_ms = time.perf_counter(), runtime.input_ms
        tenths = AT_ADVICE if self._advised else 0 if self.waits_for_advice else EARLY
        reads_ms = input_ms - self.scenario.bti.delta_ms * tenths // 10
        if reads_ms <= now_ms:
            self._advised = False
            self._note_late(now_ms - input_ms)
            what, done = "reading", await self._read(runtime, now_ms)
        elif runtime.check_ms <= now_ms:
            what, done = "check", []
            runtime.on_check(now_ms)
        elif runtime.wake_ms <= now_ms:
            what, done = "audit", runtime.on_wake(now_ms)
        elif runtime.audit_ms <= now_ms:
            what, done = "audit", runtime.on_audit(now_ms)
        elif packet := self.radio.take():
            taken = self.clock.taken
            what, done = "packet", runtime.on_packet(now_ms, packet)
            if self.clock.taken > taken:  # the a-node accepted the packet
                self._overhear(now_ms, packet)
        else:
            wait_ms = min(reads_ms, runtime.due_ms) - now_ms
            self._lateness.did("waiting", wait_ms)
            return wait_ms
        self._perform(done)
        self._note(what, 1000 * (time.perf_counter() - began_s))
        self._lateness.did(f"a {what}")
        return 0.0

    def _note_late(self, late_ms: int) -> None:
        delta_ms = self.scenario.bti.delta_ms
        if late_ms > max(delta_ms / 2, self.longest_ms["late"]):
            limit = f", and its auditors allow {delta_ms} ms" if late_ms > delta_ms else ""
            self.why_late = f"a reading was {late_ms} ms late{limit}: {self._lateness.why()}"
            log.warning("robot %d: %s", self.id, self.why_late)
        self._note("late", late_ms)

    async def _read(self, runtime: Runtime, now_ms: int) -> list[Done]:
        until_ms = runtime.input_ms + self.scenario.bti.delta_ms * LATE // 10
        try:
            reading = await self._hardware.sense(now_ms, max(0, until_ms - now_ms) / 1000 / self.clock.speed)
        except NoReading as error:
            self._note_missing(now_ms, str(error))
            return runtime.on_reading(self.clock.now_ms(), no_reading(self._reads, self.id, now_ms))
        if self.no_reading:
            log.warning("robot %d has readings again, after %.1f s", self.id, (now_ms - self.no_reading[0]) / 1000)
            self.no_reading = None
        if self.far:
            advice = self.far.advice(reading)
        else:
            advice = advice_of(self._planner, now_ms, reading) if self._planner else b""
        return runtime.on_reading(self.clock.now_ms(), reading, advice)

    def _note_missing(self, now_ms: int, why: str) -> None:
        if self.no_reading is None:
            self._hardware.stop()
            log.warning("robot %d stops its motors: no reading: %s", self.id, why)
        self.no_reading = (self.no_reading[0] if self.no_reading else now_ms), why

    def _overhear(self, now_ms: int, packet: bytes) -> None:
        if self.far:
            self.far.forward_state(packet)
        elif self._planner:
            forward_state(self._planner, now_ms, packet)

    def _perform(self, todo: list[Done]) -> None:
        assert self.runtime
        waiting = deque(todo)
        while waiting:
            done = waiting.popleft()
            if isinstance(done, Transmit):
                self.radio.send(done.packet)
                if request.is_fragment(row(done.packet), len(done.packet)):
                    # No radio acknowledgement: an auditor that missed it sends no token, and another is asked.
                    waiting.extend(self.runtime.on_sent(self.clock.now_ms(), arrived=True))
            elif isinstance(done, Actuate):
                if self.no_reading is None:  # otherwise the motors stay stopped
                    self._hardware.drive(done.command)
            elif done.refusal == Refusal.NONE:
                self._count(self.given, done.auditee)
            else:
                self._count(self.refused, (done.auditee, done.refusal))

    def _count(self, audits: dict[_Audit, tuple[int, int]], audit: _Audit) -> None:
        audits[audit] = audits.get(audit, (0, 0))[0] + 1, self.clock.now_ms()

    def _note(self, what: str, took_ms: float) -> None:
        self.longest_ms[what] = max(self.longest_ms[what], took_ms)

    @property
    def cpu_share(self) -> float:
        """Return the share of a processor core used since the mission began, without the trusted nodes."""
        return (time.process_time() - self._cpu_s) / max(time.monotonic() - self.began_s, 1e-9)

    @property
    def first_deviation_ms(self) -> int | None:
        """Return when this robot first deviated, by its own clock; None for an honest robot.

        Never before the attack begins: the honest controller beside it knows its nodes' time only to a millisecond.
        """
        if not isinstance(self.robot, Liar) or self.robot.first_deviation_ms is None:
            return None
        began_ms = self.robot.plan.start_ms
        return max(self.robot.first_deviation_ms, began_ms) if self.clock.now_ms() >= began_ms else None

    def close(self) -> None:
        """Close the driver and a planner in another process, and release the trusted nodes."""
        self._lateness.close()
        if self.far:
            self.far.close()
        self._hardware.close()
        elsewhere.unregister_remote(self._rows)
