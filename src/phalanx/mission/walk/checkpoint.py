"""A walk's state as bytes: what goes into a robot's checkpoint, which other robots read.

No gate, no secret and no proof of a visit is among them, nor a reading: where the robot has been, which ways lead on
from there, and what it is about. One state has one spelling. The layout is tabled in docs/spec/mission.md.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from types import MappingProxyType

from phalanx.config.mission import TWO_PI, MissionConfig
from phalanx.crypto.sha3 import DIGEST_BYTES
from phalanx.errors import UsageError
from phalanx.mission.angles import wrap_rad
from phalanx.mission.file.canonical import action_bytes, parse_action
from phalanx.mission.file.reader import Reader, text_of
from phalanx.mission.file.records import EncodedMission, NodeRecord, Profile
from phalanx.mission.observable import LANDMARK_TYPES, Action, Landmark, sector_of
from phalanx.mission.refused import MalformedMission

from .opening import Known, OpenWay
from .state import State
from .table import Phase
from .walker import LONGEST_S

NOBODY = 0xFFFFFFFF
NO_SECTOR = 0xFFFF
NO_LANDMARK = 0xFF
_PHASES = tuple(Phase)
_HEAD = struct.Struct("<BIIdddddd")
_KNOWN = struct.Struct("<IBddB")
_LANDMARK = struct.Struct("<ddd")
_LENGTH = struct.Struct("<IId")
_PAIR = struct.Struct("<II")
_MOST_MAP_M, _MOST = 1e6, 1e9


def encode_state(mission: EncodedMission, state: State) -> bytes:
    """The state without its keyring.

    Source: docs/spec/mission.md (Under audit).
    """
    since = math.nan if state.since_s is None else state.since_s
    along = (state.t_s, since, state.fixed_at_m, state.left_at_m, *state.pulled_m)
    out = [_HEAD.pack(_PHASES.index(state.phase), _number(state.at), _number(state.target), *along)]
    out.append(struct.pack("<I", len(state.opened)))
    out += [_known(mission, node, known) for node, known in state.opened.items()]
    out.append(struct.pack("<I", len(state.lengths_m)))
    out += [_LENGTH.pack(*way, metres) for way, metres in state.lengths_m.items()]
    out.append(struct.pack("<I", len(state.blocked)))
    out += [_PAIR.pack(*way) for way in sorted(state.blocked)]
    out.append(struct.pack(f"<I{len(state.others)}I", len(state.others), *sorted(state.others)))
    out.append(bytes([len(state.heard)]))
    out += [bytes([len(message)]) + message for message in state.heard]
    return b"".join(out)


def parse_state(mission: EncodedMission, reader: Reader) -> State:
    """The state that comes next, with an empty keyring.

    Raises: MalformedMission: no walk of this mission can be in it.
    """
    phase, at, target, t_s, since_s, fixed_at_m, left_at_m, *pulled_m = reader.unpack(_HEAD)
    if phase >= len(_PHASES) or not (math.isfinite(t_s) or t_s == -math.inf):
        raise MalformedMission("a walk in no phase, or at no time")
    _finite(fixed_at_m, left_at_m, *pulled_m)
    _finite(*([] if math.isnan(since_s) else [since_s]), below=LONGEST_S)
    count = len(mission.nodes)
    opened = dict(_parse_known(mission, reader) for _ in range(_count(reader, count)))
    ways = sum(len(node.ways) for node in mission.nodes)
    lengths = {}
    for _ in range(_count(reader, ways)):
        source, goal, metres = reader.unpack(_LENGTH)
        _finite(metres)
        lengths[_way(mission, source, goal)] = float(metres)
    blocked = [_way(mission, *reader.unpack(_PAIR)) for _ in range(_count(reader, ways))]
    others = [_node(mission, reader.number(4)) for _ in range(_count(reader, count))]
    heard = tuple(reader.short() for _ in range(reader.number(1)))
    if any(len(message) > DIGEST_BYTES for message in heard):
        raise MalformedMission("a message longer than any that is kept")
    state = State(
        phase=_PHASES[phase],
        at=None if at == NOBODY else at,
        target=None if target == NOBODY else _node(mission, target),
        t_s=t_s,
        since_s=None if math.isnan(since_s) else since_s,
        fixed_at_m=fixed_at_m,
        left_at_m=left_at_m,
        pulled_m=(pulled_m[0], pulled_m[1]),
        opened=MappingProxyType(opened),
        lengths_m=MappingProxyType(lengths),
        blocked=frozenset(blocked),
        others=frozenset(others),
        heard=heard,
    )
    if state.at is not None and state.at not in opened:
        raise MalformedMission("a walk at a node that it has not opened")
    return state


def state_capacity(mission: EncodedMission, config: MissionConfig, pool: tuple[Action, ...]) -> int:
    """The longest that a state of this mission gets, in bytes; without what other robots report, and codes' texts.

    Args:
        mission: that is walked.
        config: of the robot.
        pool: actions it can do, of which a way may need one.
    """
    longest = max([len(action_bytes(action)) for action in pool], default=0)

    def node_bytes(node: NodeRecord) -> int:
        # What is told of the ways fits into the sealed payload that tells it.
        actions = longest * len(node.ways) if mission.header.profile is Profile.PAPER else len(node.payload)
        ways = (_LENGTH.size + _PAIR.size + 4) * len(node.ways)
        return _KNOWN.size + _LANDMARK.size + 2 + ways + actions

    heard = 1 + config.messages_kept * (1 + DIGEST_BYTES)
    return _HEAD.size + 16 + sum(node_bytes(node) for node in mission.nodes) + heard


def _number(node: int | None) -> int:
    return NOBODY if node is None else node


def _known(mission: EncodedMission, node: int, known: Known) -> bytes:
    place = (math.nan, math.nan) if known.place_m is None else known.place_m
    landmark = known.landmark
    kind = NO_LANDMARK if landmark is None else LANDMARK_TYPES.index(landmark.type)
    out = [_KNOWN.pack(node, known.alias, *place, kind)]
    if landmark is not None:
        turn = math.nan if landmark.orientation_rad is None else landmark.orientation_rad
        text = (landmark.text or "").encode()
        if len(text) > 0xFFFF:
            raise UsageError("a code of more than 65535 bytes", "a shorter one")
        out.append(_LANDMARK.pack(landmark.x_m, landmark.y_m, turn) + struct.pack("<H", len(text)) + text)
    for way in known.ways:
        sectors = mission.header.coding.sectors
        sector = NO_SECTOR if way.direction_rad is None else sector_of(way.direction_rad, sectors)
        action = b"" if way.do is None else action_bytes(way.do)
        out.append(struct.pack("<HH", sector, len(action)) + action)
    return b"".join(out)


def _parse_known(mission: EncodedMission, reader: Reader) -> tuple[int, Known]:
    node, alias, x_m, y_m, kind = reader.unpack(_KNOWN)
    record = mission.nodes[_node(mission, node)]
    if alias >= len(record.aliases):
        raise MalformedMission("an alias that is not there")
    place = None if math.isnan(x_m) else (float(x_m), float(y_m))
    if place is not None:
        _finite(*place)
    landmark = None if kind == NO_LANDMARK else _parse_landmark(kind, reader)
    return node, Known(alias, place, landmark, tuple(_parse_ways(mission, record, reader)))


def _parse_landmark(kind: int, reader: Reader) -> Landmark:
    if kind >= len(LANDMARK_TYPES):
        raise MalformedMission("a landmark of no type")
    x_m, y_m, turn = reader.unpack(_LANDMARK)
    _finite(x_m, y_m, *([] if math.isnan(turn) else [turn]), below=_MOST_MAP_M)
    text = text_of(reader.long())
    return Landmark(LANDMARK_TYPES[kind], x_m, y_m, None if math.isnan(turn) else turn, None, text or None)


def _parse_ways(mission: EncodedMission, record: NodeRecord, reader: Reader) -> Iterator[OpenWay]:
    sectors = mission.header.coding.sectors
    for way in record.ways:
        sector, action = reader.number(2), reader.long()
        if sector >= sectors and sector != NO_SECTOR:
            raise MalformedMission("a direction in no sector")
        direction = None if sector == NO_SECTOR else wrap_rad(sector * TWO_PI / sectors)
        yield OpenWay(way.target, direction, parse_action(action) if action else None)


def _count(reader: Reader, limit: int) -> int:
    count = reader.number(4)
    if count > limit:
        raise MalformedMission(f"{count} of what there are {limit}")
    return count


def _node(mission: EncodedMission, node: int) -> int:
    if node >= len(mission.nodes):
        raise MalformedMission("a node that is not there")
    return node


def _way(mission: EncodedMission, source: int, target: int) -> tuple[int, int]:
    if not any(way.target == target for way in mission.nodes[_node(mission, source)].ways):
        raise MalformedMission("a way that is not there")
    return source, target


def _finite(*values: float, below: float = _MOST) -> None:
    if not all(abs(value) < below for value in values):
        raise MalformedMission("a number that no walk comes to")
