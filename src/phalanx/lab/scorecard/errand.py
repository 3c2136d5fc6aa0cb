"""Small building and mission on which attacks on missions are tried.

Three rooms in a row are connected by doors. A code on the far wall of the third identifies the shelf. The robot picks
goods there, and hands them over at a side door after a controller's release message.
"""

from __future__ import annotations

import math
from functools import cache

from phalanx.config.mission import CodingConfig
from phalanx.mission import Action, Draft, Landmark, Mission, Position
from phalanx.mission.landmarks import FloorPlan, WallCode, floorplan_of_yaml

# Area that an adversary must search who knows only an upper limit for the size of the building.
AREA_M = (0.0, 0.0, 40.0, 40.0)
START = (1.5, 2.0, 0.0)
TOKEN = "7d1f0c52a9e84b3666c0e2f1b8d49a07"  # noqa: S105  # printed on a wall
RELEASED = "goods-released"
SHELF_WITHIN_M, DOOR_WITHIN_M = 3.0, 2.5
TIMEOUT_S = 15
_SHELF = Landmark("qr", 18.0, 3.0, math.pi, text=TOKEN)
_BUILDING = b"""
name: errand
size: [18, 8]
start_pose: [1.5, 2.0, 0.0]
walls:
- [0, 0, 18, 0]
- [0, 0, 0, 8]
- [18, 0, 18, 8]
- [0, 8, 14.2, 8]
- [15.8, 8, 18, 8]
- [5, 0, 5, 2.2]
- [5, 3.8, 5, 8]
- [10, 0, 10, 4.1]
- [10, 5.9, 10, 8]
"""


@cache
def building() -> FloorPlan:
    """Return the three rooms, with the code on the wall of the third."""
    code = WallCode(TOKEN, _SHELF.x_m - 0.01, _SHELF.y_m, 0.3, math.pi)
    plan = floorplan_of_yaml(_BUILDING)
    return FloorPlan(plan.name, plan.walls, plan.outlines, plan.bounds, plan.start, (code,))


def shelf_errand(coding: CodingConfig | None = None) -> Mission:
    """Return the mission: fetch from the shelf and hand over."""
    draft = Draft("errand", coding=coding, area_m=AREA_M)
    draft.node("start", Position(*START[:2]), start=True, timeout_s=TIMEOUT_S)
    draft.node("first door", Landmark("doorway", 5.0, 3.0, math.pi / 2), within_m=DOOR_WITHIN_M, timeout_s=TIMEOUT_S)
    draft.node("second door", Landmark("doorway", 10.0, 5.0, math.pi / 2), within_m=DOOR_WITHIN_M, timeout_s=TIMEOUT_S)
    draft.node("shelf", _SHELF, do=Action("pick"), within_m=SHELF_WITHIN_M, timeout_s=TIMEOUT_S)
    draft.node(
        "hand-over",
        Landmark("doorway", 15.0, 8.0, 0.0),
        do=Action("hand_over"),
        wait=(RELEASED,),
        within_m=DOOR_WITHIN_M,
        final=True,
    )
    for node, following in zip(draft.nodes[:-1], draft.nodes[1:], strict=True):
        draft.way(node.name, following.name)
    return draft.mission()


def shelf_mission(coding: CodingConfig | None = None) -> Mission:
    """Return the node with the token as a separate mission, whose start key reveals everything but the token."""
    draft = Draft("shelf", coding=coding)
    draft.node("shelf", _SHELF, do=Action("pick"), within_m=SHELF_WITHIN_M, start=True)
    return draft.mission()


def stolen_mission() -> Mission:
    """Return the adversary's mission: hand over the load at the first door."""
    draft = Draft("theft")
    draft.node("start", Position(*START[:2]), start=True, timeout_s=TIMEOUT_S)
    draft.node(
        "first door",
        Landmark("doorway", 5.0, 3.0, math.pi / 2),
        do=Action("hand_over"),
        within_m=DOOR_WITHIN_M,
        final=True,
    )
    draft.way("start", "first door")
    return draft.mission()
