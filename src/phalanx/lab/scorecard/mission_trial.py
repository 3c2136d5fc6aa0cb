"""Run one attack on a mission against one defence, and the same mission without it; check the declared verdict.

With defence `none` the robot follows the mission as a plain graph, and believes its sensors. With `paper` the mission
has the paper profile, is unsigned, and the robot runs whatever it receives. With `hardened`, ours, the mission is
sealed, signed, bound to this robot and to a time window, and can be started once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from numpy.typing import NDArray

from phalanx.attacks.missions.between import Between, MissionPlan, Sent
from phalanx.attacks.missions.unprotected import PlainWalker
from phalanx.config.defence import Defence
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.errors import PeerError, UsageError
from phalanx.lab.cracking.guesses import Guess
from phalanx.lab.scorecard.flock_trial import Trial, trial_fields
from phalanx.mission import (
    BuildOptions,
    Mission,
    Phase,
    Profile,
    Walker,
    admit,
    build,
    check_signature,
    parse_mission,
    parse_start_key,
    public_key,
    sign,
)
from phalanx.mission.graph import Node
from phalanx.mission.landmarks import FloorPlan, LaserScan
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.robot.adversary.attack import Attack, Verdict
from phalanx.robot.adversary.harm import FALSE_FIX_M, FALSE_FIX_RAD, ErrandOutcome, GuessOutcome
from phalanx.world.building.odometry import OdometryNoise, Pose
from phalanx.world.missions.body import Building
from phalanx.world.missions.setup import MissionRun, Part, pool_of
from phalanx.world.missions.world import STEP_S, MissionRobot, MissionWorld

from .errand import AREA_M, START, building, shelf_errand, shelf_mission, stolen_mission

ROBOT, OTHER, ADVERSARY = 1, 2, 3
DAY_S = 86_400
NOW_S = DAY_S + 3600.0
DURATION_S = 150.0
# If the robot believes to be at a node at more than this distance, it was deceived.
FALSE_NODE_M = 1.0
# An action done at more than its node's distance plus this is a wrong action.
ELSEWHERE_M = 1.0
OPERATOR = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
NOISE = OdometryNoise(0.03, 0.05)
ROBOT_CONFIG = MissionConfig(timeout_s=15.0)
# The cost per try determines the duration of guessing (`try_guess`), and does not matter here.
CHEAP = CodingConfig(delta_mm=400, kdf_log2_n=2)
NO_PEOPLE = np.zeros((0, 3))
LATEST_S = 3600.0
SEALED = CodingConfig(delta_mm=400)
OUT_OF_REACH = 2.0**100  # number of tries that is infeasible


@dataclass(frozen=True, slots=True)
class Operator:
    """Operator that sends missions; two with the same seed send the same bytes."""

    defence: Defence  # determines the form of the missions
    seed: int  # of ids, gates and secrets; simulated secrets need no protection

    def send(self, mission: Mission, robot: int, day: int) -> Sent:
        """Return the mission's file, key and controller messages for a robot on a day."""
        random = np.random.default_rng([self.seed, robot, day]).bytes
        if self.defence == "hardened":
            options = BuildOptions(robots=(robot,), valid_from_s=day * DAY_S, valid_to_s=(day + 1) * DAY_S)
            (built,) = build(replace(mission, coding=mission.coding or CHEAP), options, random)
            encoded = sign(built.mission, OPERATOR)
        else:
            (built,) = build(mission, BuildOptions(profile=Profile.PAPER), random)
            encoded = built.mission
        messages = built.key.messages
        messages_sent = (name.encode() for name in messages) if self.defence == "none" else messages.values()
        return Sent(mission, encoded.encode(), built.key.encode(), tuple(messages_sent))


def admitted(
    sent: Sent, defence: Defence, now_s: float, started: Collection[bytes] = (), *, checked: bool = True
) -> Walker:
    """Return the walker of a robot that received this mission, with the ids `started` of earlier missions.

    If not `checked`, the hardened robot ignores signature, recipient, time window and id, to test the other defences.

    Raises: PeerError: the robot refuses the mission.
    """
    if defence == "none":
        return PlainWalker(sent.plain, ROBOT_CONFIG)
    mission = parse_mission(sent.file)
    if defence == "paper":
        return Walker(mission, None, ROBOT_CONFIG)
    if checked:
        check_signature(mission, [public_key(OPERATOR)])
        admit(mission, ROBOT, now_s, started)
    return Walker(mission, parse_start_key(sent.key), ROBOT_CONFIG)


class _SpoofedLidar(Lidar):
    """Lidar whose scans an attack may replace."""

    def __init__(self, plan: FloorPlan, attack: Between) -> None:
        super().__init__(plan.walls)
        self._attack = attack

    def sweep(self, pose: Pose, random: np.random.Generator, people: NDArray[np.float64] = NO_PEOPLE) -> LaserScan:
        """Return the scan from a pose, or the attack's replacement."""
        true = super().sweep
        return self._attack.scan(pose, lambda at: true(at, random, people))


class _Witness:
    """Observer that compares a robot's beliefs and actions with the simulated truth."""

    def __init__(self, robot: MissionRobot, ordered: Iterable[Node]) -> None:
        self._robot = robot
        self._due = {
            node.do.name: (node.place, node.within_m + ELSEWHERE_M) for node in ordered if node.do and node.place
        }
        self._seen = 0, 0, 0  # nodes, actions and steps of the report
        self.false_nodes = 0
        self.wrong: list[str] = []
        self.false_fixes = 0
        self.worst_fix_m = 0.0

    def look(self) -> None:
        """Evaluate the robot's report since the last call."""
        report, before = self._robot.report, self._seen
        self._seen = len(report.decoded), len(report.actions), len(report.pose_error_m)
        error_m = report.pose_error_m[-1]
        if len(report.decoded) > before[0] and error_m > FALSE_NODE_M:
            self.false_nodes += 1
        for _, action in report.actions[before[1] :]:
            place, reach_m = self._due.pop(action, ((0.0, 0.0), -1.0))
            if math.dist(self._robot.body.wheels.pose[:2], place) > reach_m:
                self.wrong.append(action)
        outcome = self._robot.controller.outcome
        is_new = len(report.pose_error_m) > before[2] and outcome is not None and outcome.fix is not None
        if is_new and (error_m > FALSE_FIX_M or report.heading_error_rad[-1] > FALSE_FIX_RAD):
            self.false_fixes += 1
            self.worst_fix_m = max(self.worst_fix_m, error_m)


def walk(attack: Between, today: Sent, defence: Defence, seed: int, *, checked: bool = True) -> ErrandOutcome:
    """Run a robot's mission with an attack on its communication and sensors; `checked` as in `admitted`."""
    sent = attack.deliver(today)
    now_s = NOW_S + attack.clock_s
    try:
        started = [parse_mission(sent.file).header.mission_id] if attack.again else []
        walker = admitted(sent, defence, now_s, started, checked=checked)
    except PeerError as error:
        return ErrandOutcome(refused=error.reason, held=True)
    there = Building(attack.building(building()))
    there.lidar = _SpoofedLidar(there.plan, attack)
    pool = tuple(dict.fromkeys((*pool_of(shelf_errand()), *pool_of(stolen_mission()))))
    part = Part(walker.mission, None, START)
    run = MissionRun(plan=there.plan, parts=(part,), noise=NOISE, seed=seed, pool=pool, begin_s=now_s)
    world = MissionWorld(run, (ROBOT,), building=there, walkers=[walker])
    (robot,) = world.robots
    witness = _Witness(
        robot, [node for node in shelf_errand().nodes if attack.ordered and (attack.released or not node.wait)]
    )
    messages = sent.said if attack.released else ()
    for step in range(round(DURATION_S / STEP_S)):
        attack.now_s = step * STEP_S
        robot.body.wheels.left, robot.body.wheels.right = attack.wheels()
        robot.hears = attack.messages(messages if not step else ())
        world.advance(attack.now_s + STEP_S)
        witness.look()
        if robot.controller.over:
            break
    (report,) = world.finish()
    final_state = robot.controller.memory.walk
    place = None if final_state.at is None else sent.plain.nodes[final_state.at].place
    return ErrandOutcome(
        done=report.done,
        held=final_state.phase is Phase.HELD,
        decoded=tuple(node for _, node in report.decoded),
        false_nodes=witness.false_nodes,
        actions=tuple(action for _, action in report.actions),
        wrong_actions=tuple(witness.wrong),
        false_fixes=witness.false_fixes,
        worst_fix_m=round(witness.worst_fix_m, 3),
        not_validated=tuple(reason for _, reason in report.not_validated),
        from_last_m=None if place is None else round(math.dist(place, robot.body.wheels.pose[:2]), 3),
        pose_error_m=round(report.pose_error_m[-1], 3),
        t_s=round(report.t_s, 1),
    )


def plan_of(defence: Defence, seed: int, start_s: float, options: Mapping[str, float | str]) -> MissionPlan:
    """Return the plan of an adversary who has eavesdropped since yesterday."""
    operator = Operator(defence, seed)
    return MissionPlan(
        start_s=start_s,
        chance=np.random.default_rng([seed, ADVERSARY]),
        yesterday=operator.send(shelf_errand(), ROBOT, 0),
        others=operator.send(shelf_errand(), OTHER, 1),
        wanted=stolen_mission(),
        options=options,
    )


@cache
def honest_errand(defence: Defence, seed: int, *, released: bool = True) -> ErrandOutcome:
    """Run the mission without attack; without a release the robot waits for it and gives up."""
    today = Operator(defence, seed).send(shelf_errand(), ROBOT, 1)
    nobody = Between(plan_of(defence, seed, 0.0, {}))
    return walk(nobody, today if released else replace(today, said=()), defence, seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionTrial(Trial):
    """Result of an attack on a mission.

    `attacked` is the outcome of the robot's mission (`ErrandOutcome`) or of guessing (`GuessOutcome`). `honest` is the
    outcome without attack, None for guessing or if no mission was sent.
    """

    against: str  # the target of the attack
    kept: bool  # whether the outcome matches the declared verdict

    @property
    def broken(self) -> bool:
        """Return whether the outcome contradicts the declared verdict."""
        return not self.kept


def try_mission_attack(
    attack: Attack, defence: Defence, seed: int = 0, options: Mapping[str, float | str] | None = None
) -> MissionTrial:
    """Run an attack on a mission or on a captured file, and measure the outcome in the simulated world.

    Options: `at`, start of the attack, s; `bit`, the bit that `flip-bit` inverts; `unchecked`, 1 for a hardened robot
    that ignores signature, recipient and time window.

    Raises: UsageError: no such option, or its value is out of range.
    """
    kind, given = attack.kind, dict(options or {})
    attack.check(given)
    start_s = float(given.get("at", kind.starts_s))
    if seed < 0 or not 0 <= start_s <= LATEST_S:
        raise UsageError(
            f"{attack.name} at {start_s:g} s, seed {seed}", f"use 0 to {LATEST_S:g} s, and a seed of 0 or more"
        )
    instance = kind(plan_of(defence, seed, start_s, given))
    honest: ErrandOutcome | None = None
    attacked: ErrandOutcome | GuessOutcome
    if isinstance(instance, Guess):
        attacked = try_guess(instance, defence, seed)
    else:
        today = Operator(defence, seed).send(shelf_errand(), ROBOT, 1)
        attacked = walk(instance, today, defence, seed, checked=not given.get("unchecked"))
        if kind.ordered:
            honest = honest_errand(defence, seed, released=kind.released)
    harm = attack.harm.of(attacked)
    return MissionTrial(
        **trial_fields(attack, defence),
        against=attack.against,
        kept=is_kept(attack.verdicts[defence], attack, attacked, harm),
        harm=harm,
        attacked=attacked,
        honest=honest,
    )


def try_guess(
    attack: Guess, defence: Defence, seed: int, *, coding: CodingConfig | None = None, tries: int | None = None
) -> GuessOutcome:
    """Run a guessing attack on one core with about `tries` tries; by default with the attack's own limit.

    The captured mission has the form that `defence` gives it. `coding` None costs as much per try as for real robots.
    """
    coding = coding or (SEALED if defence == "hardened" else None)
    plain = shelf_mission(coding) if attack.one_node else shelf_errand(coding)
    sent = Operator(defence, seed).send(plain, ROBOT, 1)
    nodes = len(plain.nodes)
    if defence == "none":
        return GuessOutcome(nodes, nodes, 0, 0.0, 0.0, 0.0, 0.0)
    profile = parse_mission(sent.file).header.profile
    most = attack.tries_max[profile] if tries is None else tries
    read: set[int] = set()
    tries_made, of = 0, 0
    began = time.perf_counter()
    for batch in attack.guess(sent, AREA_M, building()):
        tries_made, of = tries_made + batch.tries, batch.of
        read |= {found.node for found in batch.found}
        if tries_made >= most:
            break
    seconds = time.perf_counter() - began
    rate = tries_made / seconds
    whole = attack.in_all(plain, of)
    return GuessOutcome(nodes, len(read), tries_made, seconds, rate, whole, whole / rate)


def is_kept(declared: Verdict, attack: Attack, attacked: ErrandOutcome | GuessOutcome, harm: float) -> bool:
    """Return whether a declared verdict was observed, with this harm. Source: docs/reference/attacks.md (verdicts)."""
    if declared in ("bites", "not covered"):
        return harm >= attack.bites_from
    if isinstance(attacked, GuessOutcome):
        return harm == 0 and (attacked.candidates >= OUT_OF_REACH) == (declared == "harmless")
    if attacked.wrong_actions or attacked.false_nodes:
        return False
    if declared == "stopped":
        gave_a_reason = bool(attacked.refused or attacked.not_validated)
        return attacked.held and gave_a_reason and not attacked.done and attacked.worst_fix_m <= FALSE_FIX_M
    if declared == "limited":
        return harm <= attack.limit
    return attacked.done and harm < attack.bites_from
