"""Controller of a robot on an encoded mission, which auditors replay without its keys and its map.

Without audits, it uses more data than a chain could hold: each scan, codes seen by its camera, and reports of others.
The checkpoint is a `mission_memory`, the messages that it sends, `crumb`s of its path, and the state of the walk
(mission/walk/checkpoint.py).
Source: docs/spec/mission.md (Under audit); docs/adr/0020.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from phalanx.config import BtiConfig
from phalanx.config.mission import MissionConfig
from phalanx.mission import Action, EncodedMission, Experience, Kind, Landmark, Outcome, Phase, State, Walker
from phalanx.mission.angles import sin_cos, wrap
from phalanx.mission.file.canonical import AT_POSITION, Reader, action_bytes
from phalanx.mission.file.records import SECRET_BYTES
from phalanx.mission.landmarks.features import landmarks_in
from phalanx.mission.observable import LONGEST_S
from phalanx.mission.pose.belief import NUMBERS, Belief, belief_from_numbers
from phalanx.mission.refused import MalformedMission
from phalanx.mission.walk.checkpoint import encode_state, parse_state, state_capacity
from phalanx.mission.walk.claims import Claim
from phalanx.mission.walk.fix import fixed, initial_belief, odometry_errors_of
from phalanx.robot.controllers.python_controller import Act, Controller, EvidenceController, Output, Send
from phalanx.wire import table
from phalanx.wire.record import MalformedRecord

from .course import Course
from .evidence import BadEvidence, Eye, codes_at, pack_evidence, parse_sensed, unpack_evidence
from .pilot import TRAIL_MAX, Drive, Leg, drive
from .readings import CLEAR, CLEAR_STEP_M, SENSED_MAX_BYTES, Reading, Sensors, scan_sha1
from .surroundings import Pose, Sectors, packed, unpacked

SAID_MAX = 8
MILLI = 1000
# Landmarks farther away are ignored: a robot must be able to reach what it decodes.
SEE_M = 10.0
# A robot of radius 0.175 m may be pushing against an obstacle that is nearer than TOUCHES_M plus STEP_M, the distance
# driven between readings. ASIDE is the cosine below which a sector does not count as ahead.
TOUCHES_M, STEP_M, ASIDE = 0.2, 0.06, 0.05
ACTION_MAX_BYTES = 1024  # a-nodes accept commands of up to 2048
# Distance or turn after which a position fix by a known landmark is worth a kilobyte of evidence.
AGAIN_M, AGAIN_RAD = 1.0, 0.5
CLAIM_ROOM_BYTES, PACKING_BYTES = 1200, 64
EVIDENCE_BYTES_PER_S = 2400
_MOST = 1e9


@dataclass(frozen=True, slots=True)
class Assignment:
    """Public part of one robot's mission, which does not suffice to decode a node."""

    mission: EncodedMission
    start: Pose  # start pose: x, y in metres and heading in radians, map frame
    pool: tuple[Action, ...] = ()
    begin_s: float = 0.0  # time of the mission's clock at the robot's first reading
    wait_s: float = 0.0  # time from that reading until the robot starts to move


@dataclass(frozen=True, slots=True)
class Missions:
    """Assignments and sensors of all robots, which are the same for robots and auditors."""

    assigned: Mapping[int, Assignment]
    # Lidar and sectors
    sensors: Sensors = Sensors()  # noqa: RUF009  # frozen
    config: MissionConfig = MissionConfig()  # noqa: RUF009  # frozen
    eye: Eye | None = None  # camera of robots that read codes
    say_every: int = 6  # control periods per message
    audited: bool = True  # whether decisions use only data that auditors can check

    def controllers_of(
        self, rob_id: int, own: Walker, kind: type[MissionController] | None = None
    ) -> Callable[[int], Controller]:
        """Return a function for robot `rob_id` that makes its own controller, of a `kind`, and others' for replay."""
        others = cache(lambda auditee: Walker(self.assigned[auditee].mission, config=self.config, replays=True))

        def make(auditee: int) -> Controller:
            if auditee == rob_id:
                return (kind or MissionController)(auditee, self, own)
            return MissionController(auditee, self, others(auditee))

        return make

    def audits(self, config: BtiConfig) -> BtiConfig:
        """Return audit parameters with room for these missions. Raises: UsageError: a request would be too long."""
        walks = [state_capacity(a.mission, self.config, a.pool) for a in self.assigned.values()]
        return replace(
            config,
            reading_bytes=self.sensors.reading_bytes,
            command_bytes=table.DRIVE.size,
            state_bytes=table.MISSION_MEMORY.size + SAID_MAX * SECRET_BYTES + TRAIL_MAX * table.CRUMB.size + max(walks),
            evidence_max_bytes=CLAIM_ROOM_BYTES + self.sensors.scan_bytes + SENSED_MAX_BYTES + PACKING_BYTES,
            evidence_bytes_per_s=EVIDENCE_BYTES_PER_S,
        )


@dataclass(frozen=True, slots=True)
class Memory:
    """State of the controller."""

    belief: Belief
    odometry: Pose = (0.0, 0.0, 0.0)  # of the last reading, odometry frame
    begun_ms: int = 0  # time of the first reading, s-node's clock; 0 before
    leg: Leg = Leg()  # noqa: RUF009  # frozen
    blocked: bool = False  # the last step gave the path up as blocked
    said: tuple[bytes, ...] = ()  # encoded messages that the robot broadcasts in turn
    walk: State = State()  # noqa: RUF009  # frozen


class MissionController(EvidenceController):
    """Controller of one robot's mission, for driving and for replay.

    Args:
        walker: a walker with the robot's start key, or one for replay.

    Attributes:
        messages: messages that have just arrived, but not by radio; only without audits.
        tries: hashes or KDF calls of the last search for a claim.
        seen, outcome: input and result of the last step, None before the first; for observers only.
    """

    def __init__(self, rob_id: int, missions: Missions, walker: Walker) -> None:
        super().__init__(rob_id)
        self.missions, self.walker = missions, walker
        self.given = missions.assigned[rob_id]
        self.memory = Memory(initial_belief(missions.config, self.given.start))
        self.messages: tuple[bytes, ...] = ()
        self.tries = 0
        self.seen: Experience | None = None
        self.outcome: Outcome | None = None
        self._scan = b""
        lidar, each = missions.sensors.lidar, missions.sensors.beams_per_sector
        step = lidar.angle_increment_rad
        self._sectors = Sectors(lidar.angle_min_rad - step / 2, each * step, missions.sensors.sectors)
        ahead = self._sectors.cosines
        # Ranges per sector, in steps, below which the robot may touch something ahead
        fewer = np.arange(CLEAR) * CLEAR_STEP_M < (TOUCHES_M + STEP_M * ahead)[:, None]
        self._touching = np.where(ahead > ASIDE, fewer.sum(axis=1), 0).astype(np.uint8)
        self._extraction = replace(missions.sensors.extraction, feature_range_m=SEE_M).for_noise(lidar.noise_m)
        self._fixed = (0.0, 0.0)

    def pose(self, reading: bytes) -> Pose:
        """Return the estimated pose after one of the robot's readings."""
        return self._belief(self.missions.sensors.parse(reading)).pose

    def uncorrected_pose(self) -> Pose:
        """Return the pose by odometry alone, without any validated node."""
        (x, y, heading), (ahead, aside, turn) = self.given.start, self.memory.odometry
        sine, cosine = sin_cos(heading)
        return x + (cosine * ahead - sine * aside), y + (sine * ahead + cosine * aside), wrap(heading + turn)

    @property
    def over(self) -> bool:
        """Return whether the mission has ended, completed or not."""
        return self.memory.walk.phase in (Phase.DONE, Phase.HELD)

    # --- not replayed -------------------------------------------------------------------------------------------------

    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:  # noqa: ARG002 - independent of steps
        """Search for a node; return evidence for a found one or a known landmark, b"" for none or without audits."""
        if not self.missions.audited:
            self._scan = raw
            return b""
        now = self._parsed(reading)
        end = self.missions.sensors.scan_bytes
        if self.over or now is None or len(raw) < end:
            return b""
        seen = self._experience(t_ms, self._belief(now), now, raw)
        if self._waits(seen):
            return b""
        walk, claim, self.tries = self.walker.look(self.memory.walk, seen)
        self.memory = replace(self.memory, walk=walk)
        if claim:
            is_shown = 1 <= claim.shape.place < AT_POSITION or claim.shape.sensors
            return pack_evidence(claim, raw[:end], raw[end:]) if is_shown else pack_evidence(claim, b"")
        moved = now.travelled_m - self._fixed[0] > AGAIN_M or abs(wrap(now.pose[2] - self._fixed[1])) > AGAIN_RAD
        if moved and self.walker.pose_from_known(walk, seen):
            self._fixed = now.travelled_m, now.pose[2]
            return pack_evidence(None, raw[:end], raw[end:])
        return b""

    # --- replayed by auditors -----------------------------------------------------------------------------------------

    def on_recv(self, t_ms: int, packet: bytes) -> None:  # noqa: ARG002 - messages do not expire
        """Store an encoded message, and ignore other packets."""
        if len(packet) == table.MISSION_MESSAGE.size and packet[0] == table.KIND_MISSION_MESSAGE:
            message = packet[-SECRET_BYTES:]
            self.memory = replace(self.memory, walk=self.walker.receive(self.memory.walk, message))

    def on_evidence(self, step: int, t_ms: int, reading: bytes, evidence: bytes) -> list[Output]:
        """Advance the walk by a step, and return commands and messages."""
        now = self._parsed(reading)
        if now is None:
            return [self._drive(t_ms, Drive())]
        claim, scan = unpack_evidence(evidence, self.missions.sensors.lidar.beams) if evidence else (None, self._scan)
        # Without audits there is no evidence, and the robot's own scan need not be hashed again.
        if evidence and scan and scan_sha1(scan) != now.scan_sha1:
            raise BadEvidence("the scan's hash differs from that in the chained reading")
        if not self.memory.begun_ms:
            self.memory = replace(self.memory, begun_ms=t_ms)
        return self._step(step, t_ms, now, scan, claim)

    def _parsed(self, reading: bytes) -> Reading | None:
        """Parse a reading; return None for an invalid one, at which the robot stops."""
        try:
            return self.missions.sensors.parse(reading)
        except MalformedRecord:
            return None

    def _step(self, step: int, t_ms: int, now: Reading, scan: bytes, claim: Claim | None) -> list[Output]:
        belief = self._belief(now)
        seen = self._experience(t_ms, belief, now, scan)
        if self._waits(seen):
            self.memory = replace(self.memory, belief=belief, odometry=now.pose)
            return [self._drive(t_ms, Drive())]
        walk, outcome = self.walk(seen, claim)
        self.seen = seen
        self.outcome = replace(outcome, trials=outcome.trials + self.tries) if self.tries else outcome
        if outcome.fix is not None:
            belief = fixed(self.missions.config, belief, outcome.fix)
        own_s = 0 if walk.at is None else self.given.mission.nodes[walk.at].timeout_s
        timeout_s = own_s or self.missions.config.timeout_s
        pose = belief.pose
        leg, command = drive(self.memory.leg, outcome.order, walk.at, pose, now, self._sectors, seen.t_s, timeout_s)
        said = self.memory.said + (outcome.decoded.sends if outcome.decoded else ())
        self.memory = Memory(belief, now.pose, self.memory.begun_ms, leg, command.blocked, said[-SAID_MAX:], walk)
        return [self._drive(t_ms, command), *self._actions(t_ms, outcome), *self._messages(step)]

    def walk(self, seen: Experience, claim: Claim | None) -> tuple[State, Outcome]:
        """Return the walk after a step and its outcome, by the claim, or without audits by a search."""
        if self.missions.audited:
            return self.walker.advance(self.memory.walk, seen, claim)
        return self.walker.step(self.memory.walk, seen)

    def landmarks(self, scan: bytes, pose: Pose) -> Sequence[Landmark]:
        """Return the landmarks of a scan."""
        return landmarks_in(self.missions.sensors.scan_of(scan), self._extraction, *pose)

    def _waits(self, seen: Experience) -> bool:
        return seen.t_s < self.given.begin_s + self.given.wait_s

    def _belief(self, now: Reading) -> Belief:
        """Return the pose estimate updated with this odometry."""
        touches = bool(np.count_nonzero(now.clear < self._touching))
        driven: Belief = self.memory.belief.driven(
            self.memory.odometry, now.pose, odometry_errors_of(self.missions.config), touches=touches
        )
        return driven

    def _experience(self, t_ms: int, belief: Belief, now: Reading, scan: bytes) -> Experience:
        pose = belief.pose
        sensed = parse_sensed(scan[self.missions.sensors.scan_bytes :])
        codes = codes_at(self.missions.eye, pose, sensed.codes)
        landmarks = self.landmarks(scan, pose) if scan else ()
        begun_ms = self.memory.begun_ms or t_ms
        return Experience(
            self.given.begin_s + (t_ms - begun_ms) / MILLI,
            *pose,
            now.travelled_m,
            (*landmarks, *codes) if codes else landmarks,
            sensed.readings,
            actions=self.given.pool,
            messages=self.messages,
            blocked=self.memory.blocked,
            spread=belief.pose_covariance,
        )

    def _drive(self, t_ms: int, command: Drive) -> Act:
        speed, turn = round(command.speed_mps * MILLI), round(command.turn_radps * MILLI)
        return Act(table.DRIVE.form.pack(table.KIND_DRIVE, self.rob_id, t_ms, speed, turn))

    def _actions(self, t_ms: int, outcome: Outcome) -> list[Output]:
        """Return commands for the actions at a node that was just decoded, and on the edge from it."""
        here = outcome.decoded.do if outcome.decoded else None
        onward = outcome.order.do if outcome.event is not None and outcome.order.kind is Kind.DO else None
        said = [action_bytes(action) for action in (here, onward) if action is not None]
        head = table.ACTION.form.pack(table.KIND_ACTION, self.rob_id, t_ms)
        return [Act(head + action) for action in said if len(action) <= ACTION_MAX_BYTES]

    def _messages(self, step: int) -> list[Output]:
        said, every = self.memory.said, self.missions.say_every
        if not said or (step + self.rob_id) % every:
            return []
        return [Send(message_packet(self.rob_id, said[step // every % len(said)]))]

    # --- the checkpoint -----------------------------------------------------------------------------------------------

    def encode(self) -> bytes:
        """Encode all state that a replay needs; it contains no keys."""
        m, leg, course = self.memory, self.memory.leg, self.memory.leg.course
        around = (course.turning, *course.stop, *leg.base, leg.seen_s, course.waited_s, packed(leg.cells))
        carried = (leg.passed, leg.best_m, leg.best_s, *around, m.blocked)
        placed = (m.begun_ms, *m.belief.numbers, *m.odometry)
        head = table.MISSION_MEMORY.form.pack(*placed, *leg.key, *carried, len(m.said), len(leg.trail))
        trail = b"".join(table.CRUMB.form.pack(*crumb) for crumb in leg.trail)
        return head + b"".join(m.said) + trail + encode_state(self.given.mission, m.walk)

    def decode(self, encoding: bytes) -> None:
        """Restore a checkpoint, keeping the robot's keys. Raises: MalformedMission: not a valid state."""
        reader = Reader(encoding)
        begun_ms, *numbers = reader.unpack(table.MISSION_MEMORY)
        belief, odometry = belief_from_numbers(numbers[:NUMBERS]), tuple(numbers[NUMBERS : NUMBERS + 3])
        kind, target, begin, *rest = numbers[NUMBERS + 3 :]
        passed, best_m, best_s, turning, *around, blocked, said, crumbs = rest
        placed = belief is not None and all(abs(value) < _MOST for value in (*belief.pose, *odometry))
        timed = max(abs(best_s), abs(around[4]), abs(around[5])) < LONGEST_S
        if belief is None or not (placed and timed and abs(best_m) <= math.inf):
            raise MalformedMission("pose or time out of range")
        if kind not in range(-1, len(Kind)) or max(passed, blocked) > 1 or abs(turning) > 2:
            raise MalformedMission("invalid instruction")
        if said > SAID_MAX or crumbs > TRAIL_MAX:
            raise MalformedMission("more messages or crumbs than a robot stores")
        messages = tuple(reader.take(SECRET_BYTES) for _ in range(said))
        trail = tuple((x, y) for x, y in (reader.unpack(table.CRUMB) for _ in range(crumbs)))
        x, y, base_x, base_y, seen_s, waited_s, cells = around
        course = Course((x, y), turning, waited_s)
        key = kind, target, begin
        leg = Leg(key, bool(passed), best_m, best_s, trail, course, (base_x, base_y), seen_s, unpacked(cells))
        walk = parse_state(self.given.mission, reader)
        reader.end()
        before = self.memory
        self.memory = Memory(belief, odometry, begun_ms, leg, bool(blocked), messages, walk)
        if self.encode() != encoding:
            self.memory = before
            raise MalformedMission("not the canonical encoding of the state")


def message_packet(rob_id: int, message: bytes) -> bytes:
    """Return the packet of an encoded message, sent by a robot or by a station with an unused id."""
    return table.MISSION_MESSAGE.form.pack(table.KIND_MISSION_MESSAGE, rob_id, message)
