"""From a robot's file to its life and its end: everything made in the order in which it can fail."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from phalanx.bti.nodes import Refused, limits_of
from phalanx.config.builtin import built_in
from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.net.keyring import opened
from phalanx.net.udp_radio import Radio, UdpRadio
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.planner import MakePlanner
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.behaviour import MakeController, driving, on_stage, with_room
from phalanx.scenarios.file import find_scenario, written_scenario
from phalanx.scenarios.own import find_controller, find_planner, mistakes_in
from phalanx.scenarios.scenario import WHEELS, Scenario, for_robots

from .driver import AdvisedHardware, make_driver
from .far_planner import FarPlanner, is_far
from .kept_log import KeptLog
from .life import Life
from .on_air import HostileRadio, OnAir
from .sealed_air import SealedAir, may_send, with_room_for_seals
from .settings import RobotSettings
from .signed_mission import signed_for
from .state import EVERY_S, state_of, tell
from .trusted import OwnClock, check_may_have_key, connect_nodes, provision_keys, start

log = logging.getLogger(__name__)


def mission_of(settings: RobotSettings) -> Scenario:
    """The scenario that the file names. Raises: UsageError, Unavailable."""
    scenario = mission_in(settings.base, settings.said.mission)
    if scenario.controller == WHEELS and settings.said.radio.group:
        raise UsageError("a group, for robots that obey orders", "peers alone: each would log what the others are told")
    return with_room_for_seals(scenario) if settings.said.radio.sealed else scenario


def mission_in(folder: Path, words: str) -> Scenario:
    """The scenario of that name, or in that file of the folder. Raises: UsageError, Unavailable."""
    scenario = for_robots(find_scenario(words if words in built_in("scenarios") else str(folder / words)))
    if scenario.controller == WHEELS and not (scenario.gateway_key and scenario.operator_key):
        raise UsageError(f"{words} names no gateway_key and operator_key", "phalanx keys list shows both")
    return scenario


def controlled(scenario: Scenario, settings: RobotSettings) -> tuple[Scenario, MakeController | None]:
    """Return the scenario with room for its controller's memory, and that one if it is a file. Raises: UsageError."""
    made: MakeController | None = None
    if settings.said.controller:
        words = str(settings.path(settings.said.controller))
        _, made = find_controller(words, scenario, in_python=True)
    scenario, made, _ = on_stage(scenario, made)
    return with_room(scenario, made), made


def provision(settings: RobotSettings, keys_file: Path, passphrase: str, today: str) -> None:
    """Give the robot's nodes their limits, and a master key of the file of keys, over their line.

    They are asked before the key is used up, and it is on disk as given before they have it.
    Raises: UsageError: they, or the number, have a key already, or something in a file; Unavailable: nobody answers.
    """
    check_may_have_key(settings)
    scenario, _ = controlled(mission_of(settings), settings)
    robot = settings.said.robot
    node = connect_nodes(settings)
    try:
        if node.about.robot_id:
            raise UsageError(f"its trusted nodes are robot {node.about.robot_id}'s already", "once only: another board")
        with opened(keys_file, passphrase) as keys:
            master = keys.provision(robot, today)
        node.make(limits_of(scenario.bti, scenario.radio), sealed=settings.said.radio.sealed)
        node.load_master(master, robot)
    except Refused as error:
        raise UsageError(f"its trusted nodes refuse: {error.reason}", "another board") from error
    finally:
        node.close()


async def run_robot(
    settings: RobotSettings,
    *,
    in_arena: bool = False,
    on_air: OnAir | None = None,
    attacks: tuple[AttackSpec, ...] = (),
    make_base: Callable[[int, Scenario, Declaration], AdvisedHardware] | None = None,
) -> None:
    """Run the robot until this is cancelled; in Safe Mode it stands, and tells of it.

    Args:
        in_arena: an arena has forked this process: it has warned about the nodes already, and frozen its memory.
        attacks: who lies how, in place of what the mission says of that.
        make_base: what makes sensors, motors and planner, in place of those that the file names.
    Raises: UsageError: its file; Unavailable: nodes, radio, sensors or folder; then its nodes stop it.
    """
    scenario, controller = controlled(mission_of(settings), settings)
    limits = limits_of(scenario.bti, scenario.radio)
    said = settings.said
    signed = signed_for(settings.path(said.key), scenario, said.mission)
    with contextlib.ExitStack() as stack:
        node = connect_nodes(settings)
        stack.callback(node.close)
        if said.trusted.startswith("process") and not in_arena:
            log.warning("robot %d: its trusted nodes are a process, which protects from nobody here", said.robot)
        sealed = provision_keys(node, settings, limits)
        kept = stack.enter_context(KeptLog(settings.log_file))
        may = may_send(scenario, len(said.radio.peers), sealed=said.radio.sealed)
        radio: Radio = stack.enter_context(
            contextlib.closing(UdpRadio(said.radio.here, said.radio.peers, said.radio.group, may))
        )
        if on_air:
            log.warning("robot %d rehearses an attack on the air: %s", said.robot, on_air.name)
            radio = HostileRadio(radio, on_air, said.clock_speed)
        air = SealedAir(node, radio) if said.radio.sealed else None
        declared = driving(scenario)
        base = make_base(said.robot, scenario, declared) if make_base else None
        hardware = base or make_driver(settings, declared)
        stack.callback(hardware.close)
        planner: MakePlanner | FarPlanner | None = base.planner if base else None
        if is_far(said.planner):
            planner = FarPlanner(said.planner, settings.base, scenario, said.robot, sealed.seq)
        elif said.planner:
            planner = find_planner(str(settings.path(said.planner)))
        clock, ears = OwnClock(air or node, said.clock_speed), air or radio
        lived = replace(scenario, attacks=attacks) if attacks else scenario
        life = Life(lived, said.robot, clock, hardware, ears, planner, controller, sealed.seq)
        stack.callback(life.close)
        if not in_arena:
            gc.collect()
            gc.freeze()  # looking through what lives as long as we do takes longer than a reading may be late
        if base:
            await base.ready()
            loop = asyncio.get_running_loop()
            life.waits_for_advice = True
            base.on_advice(lambda: loop.call_soon_threadsafe(life.advised))
        hardware.begin()
        start(node, sealed)
        life.begin()
        head = {
            "robot": said.robot,
            "mission": sealed.seq,
            "t_key_ms": life.began_ms,
            "scenario": written_scenario(scenario),
            **({"signed": signed.told} if signed else {}),
        }
        kept.begin(head)
        own_files = () if in_arena else settings.own_files  # of an arena's the arena tells
        await _live(life, kept, settings.state_file, base, own_files)


async def _live(
    life: Life, kept: KeptLog, state_file: Path, base: AdvisedHardware | None, own_files: tuple[str, ...]
) -> None:
    living = asyncio.create_task(life.live(kept))
    try:
        with mistakes_in(*own_files):
            await _publish_state(life, living, state_file, base)
    except asyncio.CancelledError:
        life.why_ended = "it was told to end"
        raise
    except Exception as error:
        life.why_ended = str(error) if isinstance(error, PhalanxError) else f"{type(error).__name__}: {error}"
        raise
    finally:
        living.cancel()
        await asyncio.gather(living, return_exceptions=True)
        with contextlib.suppress(Exception):
            tell(state_file, state_of(life))


async def _publish_state(
    life: Life, living: asyncio.Task[None], state_file: Path, base: AdvisedHardware | None
) -> None:
    untold = ""
    while True:
        state = state_of(life)
        if base:
            base.tell(state)
        try:
            await asyncio.to_thread(tell, state_file, state)  # a disk that is busy holds up no reading
            untold = ""
        except Unavailable as error:  # a full disk is no reason to end
            if str(error) != untold:
                log.warning("%s", error)
            untold = str(error)
        await asyncio.wait([living], timeout=EVERY_S)
        if living.done():
            await living
            await asyncio.sleep(EVERY_S)  # it stands; what it tells stays new
