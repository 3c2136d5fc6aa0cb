"""A robot without this shield: its mission is in plain text, and it verifies nothing.

It drives from place to place by odometry, around obstacles that its lidar shows. It accepts a code by its text,
wherever the code hangs, and a message by its name.
"""

from __future__ import annotations

import math
from dataclasses import replace

from phalanx.config.mission import MissionConfig
from phalanx.mission import (
    BuildOptions,
    Claim,
    Experience,
    Kind,
    Landmark,
    Mission,
    Opened,
    Order,
    Outcome,
    Phase,
    Profile,
    Reason,
    State,
    Walker,
    build,
)
from phalanx.mission.file.canonical import Shape
from phalanx.mission.graph import Node
from phalanx.mission.observable import Cell, Offset
from phalanx.mission.walk.state import Event

ARRIVE_M = 0.5
ANY_REACH_M = 1e3
# A robot without the shield is not audited.
NOTHING_CLAIMED = Claim(0, 0, Shape(), Offset(), Cell(0, 0), b"")


class PlainWalker(Walker):
    """Follow a plain-text mission, in which a message is its own name.

    Args:
        config: of the robot; its time-out applies to nodes without one.
    """

    def __init__(self, plain: Mission, config: MissionConfig | None = None) -> None:
        # Only the graph's edges are read of this, so its "random" bytes may be zeros.
        (encoded,) = build(plain, BuildOptions(profile=Profile.PAPER), bytes)
        super().__init__(encoded.mission, None, config)
        self._nodes = plain.nodes
        self._start = next(i for i, node in enumerate(plain.nodes) if node.start)

    def step(self, state: State, seen: Experience) -> tuple[State, Outcome]:
        if state.phase is not Phase.SEEKING:
            return state, Outcome(self.order(state), reason=Reason.STOPPED)
        since_s = seen.t_s if state.since_s is None else state.since_s
        state = replace(
            state, t_s=seen.t_s, since_s=since_s, heard=tuple(dict.fromkeys((*state.heard, *seen.messages)))
        )
        target = self._start if state.target is None else state.target
        if self._has_reached(self._nodes[target], state, seen):
            return self._reach(state, seen, target)
        at = None if state.at is None else self._nodes[state.at]
        late = seen.t_s - since_s > ((at and at.timeout_s) or self.config.timeout_s)
        if late or seen.blocked:
            state = replace(state, phase=Phase.HELD)
            event, reason = (Event.TIMED_OUT, Reason.TIMED_OUT) if late else (Event.BLOCKED, Reason.NO_WAY)
            return state, Outcome(self.order(state), reason=reason, event=event)
        return state, Outcome(self.order(state), reason=Reason.NO_MATCH)

    def order(self, state: State) -> Order:
        if state.phase is not Phase.SEEKING or state.target is None:
            return super().order(state)
        return Order(Kind.GO, state.target, toward_m=self._nodes[state.target].place)

    @staticmethod
    def _has_reached(node: Node, state: State, seen: Experience) -> bool:
        if not {name.encode() for name in node.wait} <= set(state.heard):
            return False
        texts = {thing.text for alias in node.see for thing in alias if isinstance(thing, Landmark) and thing.text}
        if texts:
            reach_m = node.within_m or ANY_REACH_M
            seen_m = [(code.text, math.hypot(code.x_m - seen.x_m, code.y_m - seen.y_m)) for code in seen.landmarks]
            return any(text in texts and away_m <= reach_m for text, away_m in seen_m)
        return node.place is not None and math.dist(node.place, (seen.x_m, seen.y_m)) <= ARRIVE_M

    def _reach(self, state: State, seen: Experience, target: int) -> tuple[State, Outcome]:
        node = self._nodes[target]
        opened = Opened(
            node=target,
            alias=0,
            name=node.name,
            place_m=node.place,
            landmark=None,
            do=node.do,
            sends=(),
            ways=(),
            proof=b"",
            claim=NOTHING_CLAIMED,
        )
        following = self.map.next_target(target, (), (), {}, ())
        over = node.final or following is None
        phase, event = (Phase.DONE, Event.COMPLETED) if over else (Phase.SEEKING, Event.DECODED)
        state = replace(state, phase=phase, at=target, target=following, since_s=seen.t_s)
        return state, Outcome(self.order(state), opened, event=event)
