"""Encode the state of a mission in progress for a robot's checkpoint, which other robots read.

The bytes hold the decoded nodes, the ways from them and the present target, but no gate, secret, proof of a visit or
sensor reading. Each state has one encoding. docs/spec/mission.md has the layout.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import MappingProxyType

from phalanx.config.mission import TWO_PI, MissionConfig
from phalanx.crypto.sha3 import DIGEST_BYTES
from phalanx.errors import UsageError
from phalanx.mission.angles import wrap_rad
from phalanx.mission.file.canonical import Reader, action_bytes, parse_action, text_of
from phalanx.mission.file.records import EncodedMission, NodeRecord, Profile
from phalanx.mission.observable import (
    LANDMARK_TYPES,
    LONGEST_S,
    Action,
    Landmark,
    number_or_nan,
    number_or_none,
    sector_of,
)
from phalanx.mission.refused import MalformedMission
from phalanx.wire import missions as table

from .opening import Known, OpenWay
from .state import Phase, State

NOBODY = 0xFFFFFFFF
NO_SECTOR = 0xFFFF
NO_LANDMARK = 0xFF
_PHASES = tuple(Phase)
_MANY, _FEW = table.COUNT_U32.form, table.COUNT_U8.form
_MOST_MAP_M, _MOST = 1e6, 1e9


def encode_state(mission: EncodedMission, state: State) -> bytes:
    """Return the bytes of a state, without its keyring. Source: docs/spec/mission.md (Under audit)."""
    along = (
        state.t_s,
        number_or_nan(state.since_s),
        state.fixed_at_m,
        state.left_at_m,
        *state.corrected_m,
        state.round,
    )
    ends = (NOBODY if node is None else node for node in (state.at, state.target))
    out = [table.WALK.form.pack(_PHASES.index(state.phase), *ends, *along)]
    out += [_MANY.pack(len(state.opened)), *(_known(mission, *item) for item in state.opened.items())]
    lengths = (table.WALK_LENGTH.form.pack(*way, metres) for way, metres in state.lengths_m.items())
    out += [_MANY.pack(len(state.lengths_m)), *lengths]
    out += [_MANY.pack(len(state.blocked)), *(table.WALK_BLOCKED.form.pack(*way) for way in sorted(state.blocked))]
    out += [_MANY.pack(len(state.others)), *(table.OF_NODE.form.pack(node) for node in sorted(state.others))]
    out += [_FEW.pack(len(state.heard)), *(_FEW.pack(len(message)) + message for message in state.heard)]
    return b"".join(out)


def parse_state(mission: EncodedMission, reader: Reader) -> State:
    """Parse the state at the reader's position; its keyring is empty.

    Raises: MalformedMission: not a possible state of this mission.
    """
    phase, at, target, t_s, since_s, fixed_at_m, left_at_m, *corrected_m, round_ = reader.unpack(table.WALK)
    if phase >= len(_PHASES) or not (math.isfinite(t_s) or t_s == -math.inf):
        raise MalformedMission("a state with an unknown phase or an invalid time")
    _finite(fixed_at_m, left_at_m, *corrected_m)
    _finite(number_or_none(since_s) or 0.0, below=LONGEST_S)
    count = len(mission.nodes)
    opened = dict(_parse_known(mission, reader) for _ in range(_count(reader, count)))
    ways = sum(len(node.ways) for node in mission.nodes)
    lengths = {}
    for _ in range(_count(reader, ways)):
        source, goal, metres = reader.unpack(table.WALK_LENGTH)
        _finite(metres)
        lengths[_way(mission, source, goal)] = float(metres)
    blocked = [_way(mission, *reader.unpack(table.WALK_BLOCKED)) for _ in range(_count(reader, ways))]
    others = [_node(mission, reader.number(table.OF_NODE)) for _ in range(_count(reader, count))]
    heard = tuple(reader.behind(table.COUNT_U8) for _ in range(reader.number(table.COUNT_U8)))
    if any(len(message) > DIGEST_BYTES for message in heard):
        raise MalformedMission(f"a message longer than {DIGEST_BYTES} bytes")
    state = State(
        phase=_PHASES[phase],
        at=None if at == NOBODY else at,
        target=None if target == NOBODY else _node(mission, target),
        t_s=t_s,
        since_s=number_or_none(since_s),
        fixed_at_m=fixed_at_m,
        left_at_m=left_at_m,
        corrected_m=(corrected_m[0], corrected_m[1]),
        opened=MappingProxyType(opened),
        lengths_m=MappingProxyType(lengths),
        blocked=frozenset(blocked),
        round=round_,
        others=frozenset(others),
        heard=heard,
    )
    if state.at is not None and state.at not in opened:
        raise MalformedMission("a state at a node that is not decoded")
    return state


def state_capacity(mission: EncodedMission, config: MissionConfig, pool: tuple[Action, ...]) -> int:
    """Return the maximum length of an encoded state in bytes, without reports of other robots and texts of QR codes.

    Args:
        pool: actions of the robot; each way may need one.
    """
    longest = max([len(action_bytes(action)) for action in pool], default=0)

    def node_bytes(node: NodeRecord) -> int:
        # The actions of the ways come from the sealed payload, so they are no longer than it.
        actions = longest * len(node.ways) if mission.header.profile is Profile.PAPER else len(node.payload)
        ways = (table.WALK_LENGTH.size + table.WALK_BLOCKED.size + table.WALK_WAY.size) * len(node.ways)
        return table.WALK_NODE.size + table.WALK_LANDMARK.size + ways + actions

    heard = _FEW.size + config.messages_kept * (_FEW.size + DIGEST_BYTES)
    return table.WALK.size + 4 * _MANY.size + sum(node_bytes(node) for node in mission.nodes) + heard


def _known(mission: EncodedMission, node: int, known: Known) -> bytes:
    place = (math.nan, math.nan) if known.place_m is None else known.place_m
    landmark = known.landmark
    kind = NO_LANDMARK if landmark is None else LANDMARK_TYPES.index(landmark.type)
    out = [table.WALK_NODE.form.pack(node, known.alias, *place, kind)]
    if landmark is not None:
        turn = number_or_nan(landmark.orientation_rad)
        text = (landmark.text or "").encode()
        if len(text) > 0xFFFF:
            raise UsageError("a QR code of more than 65535 bytes", "use a shorter text")
        out.append(table.WALK_LANDMARK.form.pack(landmark.x_m, landmark.y_m, turn, landmark.apart_m, len(text)) + text)
    for way in known.ways:
        sectors = mission.header.coding.sectors
        sector = NO_SECTOR if way.direction_rad is None else sector_of(way.direction_rad, sectors)
        action = b"" if way.do is None else action_bytes(way.do)
        out.append(table.WALK_WAY.form.pack(sector, len(action)) + action)
    return b"".join(out)


def _parse_known(mission: EncodedMission, reader: Reader) -> tuple[int, Known]:
    node, alias, x_m, y_m, kind = reader.unpack(table.WALK_NODE)
    record = mission.nodes[_node(mission, node)]
    if alias >= len(record.aliases):
        raise MalformedMission("a node without the given alias")
    place = None if math.isnan(x_m) else (float(x_m), float(y_m))
    if place is not None:
        _finite(*place)
    landmark = None if kind == NO_LANDMARK else _parse_landmark(kind, reader)
    return node, Known(alias, place, landmark, tuple(_parse_ways(mission, record, reader)))


def _parse_landmark(kind: int, reader: Reader) -> Landmark:
    if kind >= len(LANDMARK_TYPES):
        raise MalformedMission("a landmark of an unknown type")
    x_m, y_m, turn, apart_m, length = reader.unpack(table.WALK_LANDMARK)
    _finite(x_m, y_m, number_or_none(turn) or 0.0, below=_MOST_MAP_M)
    text = text_of(reader.take(length))
    if math.isnan(apart_m):
        raise MalformedMission("a landmark without a distance to its next look-alike")
    return Landmark(LANDMARK_TYPES[kind], x_m, y_m, number_or_none(turn), None, text or None, apart_m)


def _parse_ways(mission: EncodedMission, record: NodeRecord, reader: Reader) -> Iterator[OpenWay]:
    sectors = mission.header.coding.sectors
    for way in record.ways:
        sector, length = reader.unpack(table.WALK_WAY)
        action = reader.take(length)
        if sector >= sectors and sector != NO_SECTOR:
            raise MalformedMission("a direction in an unknown sector")
        direction = None if sector == NO_SECTOR else wrap_rad(sector * TWO_PI / sectors)
        yield OpenWay(way.target, direction, parse_action(action) if action else None)


def _count(reader: Reader, limit: int) -> int:
    count = reader.number(table.COUNT_U32)
    if count > limit:
        raise MalformedMission(f"{count} items, at most {limit}")
    return count


def _node(mission: EncodedMission, node: int) -> int:
    if node >= len(mission.nodes):
        raise MalformedMission(f"no node {node}")
    return node


def _way(mission: EncodedMission, source: int, target: int) -> tuple[int, int]:
    if not any(way.target == target for way in mission.nodes[_node(mission, source)].ways):
        raise MalformedMission(f"no way from node {source} to {target}")
    return source, target


def _finite(*values: float, below: float = _MOST) -> None:
    if not all(abs(value) < below for value in values):
        raise MalformedMission("a number out of range")
