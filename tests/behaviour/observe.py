"""Run the oracle's cases and report what happens in them as events. Only this file reads the simulator's internals.

A refactor of the simulator changes this file and no other of the oracle; the events that it reports stay the same.
Observation is passive: the event loop runs from one microsecond with events to the next, and this file reads the
world's arrays between two such steps. No event of the simulation depends on where its loop pauses.

An event is (time in us, kind, robot's row or ALL, bytes). A refactor must keep the bytes of each kind:

    body      position, velocity, acceleration: float64 each; LED
    packet    one transmission that ended: sender, ACK target or -1, destination, receivers; then the packet
    radio     counts of sent, received and dropped packets, by class
    verdict   one audit that ended: auditor, auditee, refusal code
    stop      the robot is in Safe Mode since then
    audit     counts of the robot's audits: AUDIT_COUNTS
    chain     tops of the s-node's and the a-node's chain, with their MACs
    token     the tokens that cover the robot's two checkpoints (auditor, time, MAC), and the checkpoints' hashes
    command   acceleration or wheel speeds that changed (only in a fine-grained stream)
    mission   true pose, believed pose; then decoded nodes, actions, phase, refusals, tries as text
    outcome   final figures of the run, as text
"""

from __future__ import annotations

import contextlib
import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from numbers import Number
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from phalanx.attacks.missions.between import Between
from phalanx.bti import trusted
from phalanx.bti.fleet import PAPER, PLAIN
from phalanx.cli.mission.files import read_plain
from phalanx.config import BtiConfig
from phalanx.lab.scorecard.errand import shelf_errand
from phalanx.lab.scorecard.mission_trial import ROBOT, Operator, plan_of, try_mission_attack, walk
from phalanx.lab.scorecard.team_trial import try_in_team
from phalanx.mission import BuildOptions, Profile, build
from phalanx.robot import Led, Point
from phalanx.robot.adversary.registry import attacks
from phalanx.scenarios.attack_spec import AttackSpec, parse_attack
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_controller, find_planner
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited import loop
from phalanx.world.audited.events import next_us
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.missions.live import CompromiseRequest, TickedMission
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.report import ReportRecorder
from phalanx.world.missions.setup import MissionRun
from phalanx.world.missions.world import MissionWorld, walkers_of
from phalanx.world.radio.channel import TX_END
from phalanx.world.scenarios.run import Run
from phalanx.world.swarms.dotbots import Dotbots
from phalanx.world.swarms.protected import ProtectedSwarm

ROOT = Path(__file__).parents[2]
ALL = -1
SECOND_US = 1_000_000
AUDIT_COUNTS = (
    "alive log_len log_full step checkpoint_no round_no got accepted requests_sent tokens_got audits_passed "
    "audits_refused"
).split()
PACKET = struct.Struct("<iiii")
VERDICT = struct.Struct("<iii")
TOKEN = struct.Struct("<qq8s")
BODY = POSE = struct.Struct("<6d")
# A copy of an a-node is asked for a token request this much later, when its bucket has refilled.
LATER_MS = 10_000_000
# Room for what a trusted node answers: a time, a chain's top and a MAC.
OUT_BYTES = 40
# Names of the defences as the code has them.
DEFENCE = {"none": "none", "paper": "paper", "hardened": "hardened"}
NOW_S = 1.7e9


class Sink(Protocol):
    """Receives events.

    `period_us` is the time between two samples of what changes continuously; `fine` asks for `command` events, and for
    a `mission` event after each step of a robot.
    """

    period_us: int
    fine: bool

    def event(self, world: int, t_us: int, kind: str, robot: int, data: bytes) -> None:
        """Receive one event of the world with this number."""

    def rows(self, world: int, t_us: int, kind: str, rows: list[bytes]) -> None:
        """Receive one sample: the bytes of every robot, in the order of their rows."""


class WorldObserver:
    """Reports the events of one world of the audited event loop."""

    def __init__(self, number: int, world: Any, sink: Sink, run: Callable[[Any, int], int]) -> None:
        self.number, self._world, self._sink, self._run = number, world, sink, run
        self._now, self._verdict_count = world.clock["now_us"], world.clock["verdicts"]
        event = world.queue.event
        self._due, self._kind, self._robot = event["t_us"], event["kind"], event["robot"]
        self._arg, self._order = event["arg"], event["number"]
        self._noted_us, self._ending = -1, list[tuple[int, int, int, bytes]]()
        self._sampled_us, self._verdicts = -sink.period_us, 0
        self._stopped: set[int] = set()
        self._commanded = np.hstack((world.vel, world.acc))

    def run(self, until_us: int) -> int:
        """Run the loop to `until_us` or to an event that Python handles, and return what the loop returns."""
        sink = self._sink
        while True:
            sample_us = self._sampled_us + sink.period_us
            due_us = int(next_us(self._world.queue))
            step_us = max(min(due_us, until_us, sample_us), int(self._now[0]))
            if step_us > self._noted_us:
                self._report_packets()
                if due_us == step_us:
                    self._note_packets(step_us)
            result = self._run(self._world, step_us)
            self._report_verdicts()
            if sink.fine:
                self._report_commands()
            if result != loop.REACHED:
                return result
            if step_us == sample_us:
                self._report_packets()
                self._sample(step_us)
            if step_us >= until_us:
                return result

    # --- packets ---

    def _note_packets(self, t_us: int) -> None:
        """Keep the transmissions that end at `t_us`, before the loop handles them."""
        self._noted_us = t_us
        heap, air, due, places = self._world.queue.heap, self._world.air, self._due, set[int]()
        # The events of one microsecond are connected at the root of the heap. Stale entries behind its end do no harm.
        todo = [0]
        while todo:
            at = todo.pop()
            if at < len(heap) and due[place := int(heap[at])] == t_us:
                places.add(place)
                todo += [2 * at + 1, 2 * at + 2]
        ends = sorted((int(self._order[place]), place) for place in places if self._kind[place] == TX_END)
        for _, place in ends:
            sender, acknowledged = int(self._robot[place]), int(self._arg[place]) - 1
            if acknowledged >= 0:
                self._ending.append((sender, acknowledged, -1, b""))
                continue
            nic = air.nic[sender]
            slot = air.slot[nic.head, sender]
            length = int(slot.length)
            is_short = length <= air.short.shape[2]
            source = air.short[nic.head, sender] if is_short else air.long.rows[nic.long_row]
            self._ending.append((sender, -1, int(slot.dst), source[:length].tobytes()))

    def _report_packets(self) -> None:
        """Report the noted transmissions. Receivers are known for the last one that ends in a microsecond."""
        ending, self._ending = self._ending, []
        for k, (sender, acknowledged, to, packet) in enumerate(ending):
            receivers = b""
            count = -1
            if k == len(ending) - 1:
                count = int(self._world.clock["receivers"][0])
                receivers = self._world.receivers[:count].astype("<i4").tobytes()
            data = PACKET.pack(acknowledged, to, len(packet), count) + packet + receivers
            self._sink.event(self.number, self._noted_us, "packet", sender, data)

    # --- audits ---

    def _report_verdicts(self) -> None:
        count = int(self._verdict_count[0])
        for k in range(self._verdicts, count):
            t_us, auditor, auditee, refusal = self._world.verdicts[k % len(self._world.verdicts)].tolist()
            self._sink.event(self.number, t_us, "verdict", auditor - 1, VERDICT.pack(auditor, auditee, refusal))
        self._verdicts = count

    def _report_commands(self) -> None:
        commanded = np.hstack((self._world.vel, self._world.acc))
        for i in np.flatnonzero((commanded != self._commanded).any(axis=1)).tolist():
            self._sink.event(self.number, int(self._now[0]), "command", i, commanded[i].tobytes())
        self._commanded = commanded

    # --- samples ---

    def _sample(self, t_us: int) -> None:
        world, fleet, sink, self._sampled_us = self._world, self._world.fleet, self._sink, t_us
        bodies = np.hstack((world.pos, world.vel, world.acc))
        rows = [body + led for body, led in zip(_split(bodies), _split(world.led), strict=True)]
        sink.rows(self.number, t_us, "body", rows)
        sink.rows(self.number, t_us, "radio", _split(world.air.counts))
        for i in np.flatnonzero(world.safe_us >= 0).tolist():
            if i not in self._stopped:
                self._stopped.add(i)
                sink.event(self.number, int(world.safe_us[i]), "stop", i, b"")
        counts = np.stack([fleet.robot[name].astype(np.int64) for name in AUDIT_COUNTS], axis=1)
        sink.rows(self.number, t_us, "audit", _split(counts))
        if int(fleet.settings[0].profile) != PLAIN:
            sink.rows(self.number, t_us, "chain", self._tops())
            sink.rows(self.number, t_us, "token", self._tokens())

    def _tops(self) -> list[bytes]:
        """Return the tops of both chains of every robot, which copies of its trusted nodes reveal."""
        world, profile = self._world, int(self._world.fleet.settings[0].profile)
        ffi, lib = trusted.FIRMWARE[profile]
        nonce, out = bytes(64), ffi.new("uint8_t[]", OUT_BYTES)
        now_ms = (int(self._now[0]) + world.boot_us) // 1000 + LATER_MS

        def told(code: int) -> bytes:
            return bytes([code & 0xFF]) + (bytes(ffi.buffer(out)) if code >= 0 else b"")

        def top(i: int) -> bytes:
            snode, anode = world.fleet.snode[i].copy(), world.fleet.anode[i].copy()
            s, a = ffi.from_buffer("phx_snode *", snode), ffi.from_buffer("phx_anode *", anode)
            ffi.memmove(out, bytes(OUT_BYTES), OUT_BYTES)
            told_s = told(lib.phx_snode_make_auth(s, nonce, out))
            ffi.memmove(out, bytes(OUT_BYTES), OUT_BYTES)
            if profile == PAPER:
                return told_s + told(lib.phx_anode_make_auth(a, out))
            return told_s + told(lib.phx_anode_token_request(a, int(now_ms[i]), 0xFFFF, out))

        return [top(i) for i in range(len(world.fleet.robot))]

    def _tokens(self) -> list[bytes]:
        fleet = self._world.fleet
        hashes, token = _split(fleet.hckpt), fleet.token
        counts = np.stack((fleet.robot["tokens_start"], fleet.robot["tokens_pending"]), axis=1).tolist()
        auditor, at_ms, mac = token["auditor"], token["t"], token["mac"]
        return [
            hashes[i]
            + b"".join(
                TOKEN.pack(int(auditor[i, which, k]), int(at_ms[i, which, k]), mac[i, which, k].tobytes())
                for which in (0, 1)
                for k in range(counts[i][which])
            )
            for i in range(len(hashes))
        ]


def _split(array: np.ndarray[Any, Any]) -> list[bytes]:
    """Return the bytes of every row of an array."""
    data, size = np.ascontiguousarray(array).tobytes(), array[0].nbytes if len(array) else 0
    return [data[k : k + size] for k in range(0, len(data), size)] if size else [b""] * len(array)


@contextlib.contextmanager
def observed(sink: Sink) -> Iterator[None]:
    """Report to `sink` the events of every world that runs inside this context."""
    run, advance, note = loop.run, MissionWorld.advance, ReportRecorder.note
    # The observers keep their worlds, so that no later world has the same identity.
    observers: dict[int, tuple[WorldObserver, Any]] = {}
    running = 0

    def observer_of(world: Any) -> WorldObserver:
        key = id(world.clock)
        if key not in observers:
            observers[key] = WorldObserver(len(observers), world, sink, run), world
        return observers[key][0]

    def observed_run(world: Any, until_us: int) -> int:
        nonlocal running
        observer = observer_of(world)
        running = observer.number
        return observer.run(int(until_us))

    def observed_note(robot: Any, t_s: float) -> None:
        note(robot, t_s)
        sink.event(running, round(t_s * SECOND_US), "mission", robot.number, _mission_row(robot))

    def observed_advance(missions: MissionWorld, until_s: float) -> None:
        before_us = int(missions.world.clock["now_us"][0]) // sink.period_us
        advance(missions, until_s)
        now_us = int(missions.world.clock["now_us"][0])
        if now_us // sink.period_us > before_us:
            number = observer_of(missions.world).number
            sink.rows(number, now_us, "mission", [_mission_row(robot) for robot in missions.robots])

    loop.run, MissionWorld.advance = observed_run, observed_advance
    if sink.fine:
        ReportRecorder.note = observed_note
    try:
        yield
    finally:
        loop.run, MissionWorld.advance, ReportRecorder.note = run, advance, note


def _mission_row(robot: Any) -> bytes:
    report, memory = robot.report, robot.controller.memory
    words = (
        [(t_s, node) for t_s, node in report.decoded],
        report.actions,
        report.not_validated,
        report.hashes_tried,
        report.false_fixes,
        report.done,
        memory.walk.phase.value,
    )
    return POSE.pack(*robot.body.wheels.pose, *memory.belief.pose) + as_text(words).encode()


def as_text(value: Any) -> str:
    """Return a value as text that does not depend on the types of numbers and containers."""
    if isinstance(value, Enum):
        value = value.value
    if value is None or isinstance(value, str | bytes):
        return repr(value)
    if isinstance(value, Number | np.generic):
        return repr(float(value))
    if is_dataclass(value):
        value = [getattr(value, each.name) for each in fields(value)]
    return f"[{', '.join(map(as_text, value))}]"


# --- runners ---


def _run(sink: Sink, scenario: Scenario, controller: Any = None, **how: Any) -> None:
    run = Run(scenario, controller, **how)
    for second in range(1, round(scenario.duration_s) + 1):
        run.advance(float(second))
    told = run.summary()
    liars = [(each["robot"], each["first_deviation_s"], each["safe_mode_s"]) for each in told["compromised"]]
    figures = (
        told["mean_distance_to_goal_m"],
        told["distance_series"],
        liars,
        told["correct_in_safe_mode"],
        told["without_quorum"],
        told["contacts"],
        tuple(told["bytes_per_s_per_robot"].values()),
        told["log_bytes_max"],
        told["broadcast_delivery"],
        told["unicast_delivery"],
        tuple(told.get("task", {}).values()),
    )
    _outcome(sink, figures)


def _outcome(sink: Sink, figures: object) -> None:
    sink.event(0, 0, "outcome", ALL, as_text(figures).encode())


def _scenario(
    sink: Sink,
    *,
    scenario: str,
    duration_s: int,
    radio: Any = None,
    plain: bool = False,
    planner: str = "",
    **changes: Any,
) -> None:
    chosen, advises = find_scenario(scenario), find_planner(str(ROOT / planner) if planner else None)
    if "defence" in changes:
        changes["defence"] = DEFENCE[changes["defence"]]
    if radio:
        changes["radio"] = replace(chosen.radio, **radio)
    _run(sink, replace(chosen, duration_s=float(duration_s), **changes), planner=advises, plain=plain)


def _own(sink: Sink, *, example: str, duration_s: int, attack: str | None, defence: str = "hardened") -> None:
    scenario = Scenario(
        robots=9,
        goal_m=(120.0, 120.0),
        duration_s=float(duration_s),
        defence=DEFENCE[defence],
        attacks=(parse_attack(attack),) if attack else (),
        bti=BtiConfig(f_max=2),
    )
    _run(sink, *find_controller(str(ROOT / example), scenario))


def _attack(
    sink: Sink, *, attack: str, at_s: float, defence: str, duration_s: int, scenario: str | None = None
) -> None:
    chosen = find_scenario(scenario) if scenario else Scenario(name="attack")
    spec = AttackSpec(name=attack, at_s=at_s)
    attacks = (spec,) * spec.attack.liars(chosen.bti.f_max)
    _run(sink, replace(chosen, duration_s=float(duration_s), defence=DEFENCE[defence], attacks=attacks))


def _benchmark(sink: Sink, *, robots: int, grid_step_m: float, d_m: float, f_max: int, duration_s: int) -> None:
    bti = BtiConfig(f_max=f_max)
    _run(sink, Scenario(robots=robots, grid_step_m=grid_step_m, d_m=d_m, duration_s=float(duration_s), bti=bti))


def _errand(sink: Sink, *, attack: str | None, defence: str, unchecked: bool = False) -> None:
    # Not `try_mission_attack`: it runs the same errand without an attack too, but only once in a process.
    kind, defence = attacks()[attack].kind if attack else Between, DEFENCE[defence]
    options = {"unchecked": 1.0} if unchecked else {}
    made = kind(plan_of(defence, 0, kind.starts_s, options))
    walked = walk(made, Operator(defence, 0).send(shelf_errand(), ROBOT, 1), defence, 0, checked=not unchecked)
    _outcome(sink, walked)


def _guess(sink: Sink, *, attack: str, defence: str) -> None:
    guessed = try_mission_attack(attacks()[attack], DEFENCE[defence]).attacked
    _outcome(sink, (guessed.nodes, guessed.read, guessed.tries, guessed.candidates))


def _team(sink: Sink, *, attack: str, defence: str) -> None:
    trial = try_in_team(attacks()[attack], DEFENCE[defence])
    figures = (trial.deviated_s, trial.stopped_s, trial.bound_s, tuple(trial.refusals.items()))
    _outcome(sink, (*figures, trial.completed, trial.others, trial.in_safe_mode))


def _mission_run(mission: str, profile: str, defence: str, **how: Any) -> MissionRun:
    plain = read_plain(mission)
    options, draw = BuildOptions(profile=Profile[profile.upper()]), random.Random(how["seed"]).randbytes
    orders = orders_of(plain, build(plain, options, draw), load_floorplan(plain.floor_plan))
    return orders.run(defence=DEFENCE[defence], **how)


def _mission(
    sink: Sink, *, mission: str, profile: str, defence: str, robots: int, duration_s: int, seed: int = 0, **how: Any
) -> None:
    run = _mission_run(mission, profile, defence, robots=robots, seed=seed, duration_s=float(duration_s), **how)
    walkers, reports = walkers_of(run), []
    for numbers in [(number,) for number in range(robots)] if run.alone else [range(robots)]:
        world = MissionWorld(run, numbers, walkers=walkers)
        for second in range(1, duration_s + 1):
            if world.over:
                break
            world.advance(float(second))
        reports += world.finish()
    _outcome(sink, [(each.digest, each.done, each.drift, each.safe_mode_s, each.audits_passed) for each in reports])


def _crew(sink: Sink, *, mission: str, defence: str, robots: int, attack: str, at_s: int, duration_s: int) -> None:
    """Run the demo's mission, in which the operator compromises robot 1."""
    crew = TickedMission(_mission_run(mission, "sealed", defence, robots=robots, seed=0, duration_s=float(duration_s)))
    news: list[object] = []
    for tick in range(10 * duration_s):
        if tick == 10 * at_s:
            crew.compromise(CompromiseRequest(0, attack))
        news += crew.tick().news
    _outcome(sink, news)


def _demo(sink: Sink, *, robots: int, duration_s: int, attack: str = "", at_s: float = 0.0, protocol: str = "") -> None:
    """Run the demo's swarm: one robot follows a route, one is driven, one shows a colour, one may be compromised."""
    swarm = ProtectedSwarm(robots, 0, lambda: NOW_S, protocol=protocol)
    names = [robot.address for robot in swarm.robots()]
    for tick in range(50 * duration_s):
        if tick == 100:
            swarm.follow(names[0], [Point(400, 400), Point(1600, 1500)], 50)
            swarm.set_led(names[1], Led(10, 200, 30))
        if 150 <= tick < 400 and tick % 5 == 0:
            swarm.drive(names[2], 60, 40)
        if attack and tick == round(50 * at_s):
            swarm.compromise(names[3], attack)
        swarm.step(0.02)
    _outcome(sink, [(robot.at, robot.direction_deg, robot.led) for robot in swarm.robots()])


def _dotbots(sink: Sink, *, robots: int, duration_s: int) -> None:
    """Run the unprotected swarm: the same orders, without radio or audits."""
    swarm = Dotbots(robots, 0, lambda: NOW_S)
    names = [robot.address for robot in swarm.robots()]
    swarm.follow(names[0], [Point(400, 400), Point(1600, 1500)], 50)
    swarm.set_led(names[1], Led(10, 200, 30))
    swarm.drive(names[2], 60, 40)
    for second in range(1, duration_s + 1):
        for _ in range(50):
            swarm.step(0.02)
        rows = [
            BODY.pack(robot.at.x_mm, robot.at.y_mm, robot.direction_deg, robot.battery_v, 0.0, 0.0)
            + bytes((robot.led.red, robot.led.green, robot.led.blue))
            for robot in swarm.robots()
        ]
        sink.rows(0, second * SECOND_US, "body", rows)


RUNNERS: dict[str, Callable[..., None]] = {
    "scenario": _scenario,
    "own": _own,
    "attack": _attack,
    "benchmark": _benchmark,
    "errand": _errand,
    "guess": _guess,
    "team": _team,
    "mission": _mission,
    "crew": _crew,
    "demo": _demo,
    "dotbots": _dotbots,
}
