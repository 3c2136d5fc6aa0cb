"""The tour of `phalanx up --tour`: show the three shields in three minutes, with captions on the projector.

Each act is a separate gateway with the same port, pages, keys and visitors: phones and the projector reconnect by
themselves. After the last act the first one starts again.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import secrets
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

from phalanx.errors import PhalanxError
from phalanx.net import Client
from phalanx.net.ports import free_port
from phalanx.robot import Swarm

from .running import Running
from .session_link import EventSink
from .shields import ShieldWatch
from .up import DEFAULT_PORT, UpOptions, up

log = logging.getLogger(__name__)

ACT_S = 60.0
SETTLE_S, DRIVE_S, LOOK_S = 5.0, 4.0, 0.5
BENDS = ((60, 60), (70, 40), (40, 70))  # wheels, percent
ATTACK = "hijack"  # its effect is easy to see
LINK = "Shield 1: only phones that scanned the code can drive."
MISSION = "Shield 2: robots find their way by landmarks, and a stolen mission reveals nothing."
AUDITS = "Shield 3: robots check each other. Each arc of a ring is a neighbour that vouches."

MakeSwarm = Callable[[], AbstractContextManager[Swarm]]
Script = Callable[[Running], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class Act:
    """One part of the tour."""

    swarm: MakeSwarm
    script: Script


async def tour(
    options: UpOptions, say: EventSink, started: Callable[[Running], None], driven: MakeSwarm, mission: MakeSwarm
) -> None:
    """Run the tour until cancelled. `driven` makes robots that visitors drive, `mission` those that run a mission.

    Raises: UsageError, Unavailable: as `up`.
    """
    options = replace(
        options,
        port=options.port or free_port(DEFAULT_PORT, options.host),
        operator_port=options.operator_port or free_port(),
        operator_token=options.operator_token or secrets.token_hex(16),
        duration_s=ACT_S,
    )
    acts = (Act(driven, show_link), Act(mission, show_mission), Act(driven, show_audits))
    gateways: list[Running] = []
    for act in itertools.cycle(acts):
        await _play(act, options, say, started, gateways)


async def _play(
    act: Act, options: UpOptions, say: EventSink, started: Callable[[Running], None], gateways: list[Running]
) -> None:
    """Run one act; `gateways` holds the previous act's gateway, and this one's afterwards."""
    scripts: list[asyncio.Task[None]] = []

    def begin(running: Running) -> None:
        before = gateways[:]
        gateways[:] = [running]
        started(running)
        # An operator's stop lasts across acts until the operator releases it; it can also come between two acts.
        if any(gateway.gateway.brakes.held for gateway in before):
            running.hold(True)
        scripts.append(asyncio.ensure_future(_follow(act.script, running)))

    with act.swarm() as swarm:
        try:
            await up(options, say, begin, swarm=lambda: swarm)
        finally:
            for script in scripts:
                script.cancel()
            await asyncio.gather(*scripts, return_exceptions=True)


async def _follow(script: Script, running: Running) -> None:
    try:
        await script(running)
    except PhalanxError as error:
        log.info("the visitor of the tour has left: %s", error)  # the tour continues


async def show_link(running: Running) -> None:
    """Drive one robot after the other, as a visitor."""
    running.projector.caption = LINK
    await asyncio.sleep(SETTLE_S)
    invitation = running.desk.do("invite", {"role": "drive", "uses": 1, "name": "Tour"})
    async with Client(invitation["url"]) as visitor:
        for robot in itertools.cycle(running.gateway.swarm.robots()):
            running.projector.caption = f"A visitor drives {robot.name}. {LINK}"
            for left, right in BENDS:
                await visitor.drive(robot.address, left, right, for_s=DRIVE_S)


async def show_mission(running: Running) -> None:
    """Show what robots have decoded."""
    while True:
        missions = running.gateway.missions
        walks: dict[str, Any] = missions.state()["robots"] if missions else {}
        decoded = max((walk["decoded"] for walk in walks.values()), default=0)
        found = f" So far {decoded} landmarks." if decoded else ""
        running.projector.caption = MISSION + found
        await asyncio.sleep(LOOK_S)


async def show_audits(running: Running) -> None:
    """Compromise one robot until the others have it stopped, then revive it."""
    shields = running.gateway.shields
    assert shields is not None, "these robots audit each other"
    running.projector.caption = AUDITS
    await asyncio.sleep(2 * SETTLE_S)
    robot = running.gateway.swarm.robots()[0]
    running.desk.do("compromise", {"address": robot.address, "attack": ATTACK})
    running.projector.caption = f"{robot.name} is compromised now. Watch its neighbours detect it."

    await _until(shields, robot.address, stopped=True)
    running.projector.caption = f"{robot.name} was stopped: its neighbours no longer vouch for it."
    await asyncio.sleep(2 * SETTLE_S)
    shields.revive(robot.address)
    await _until(shields, robot.address, stopped=False)
    running.projector.caption = f"{robot.name} is back, with its honest program. Its neighbours vouch for it again."


async def _until(shields: ShieldWatch, address: str, *, stopped: bool) -> None:
    """Wait until a robot is stopped, or runs again."""
    while shields.is_stopped(address) != stopped:  # noqa: ASYNC110 - a swarm has no event for it
        await asyncio.sleep(LOOK_S)
