"""Set up a robot from its file, run it, and end it; parts are created in the order in which they can fail."""

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
from phalanx.net.keyring import open_keyring
from phalanx.net.udp_radio import Radio, UdpRadio
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.planner import MakePlanner
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.behaviour import MakeController, declaration_of, with_protocol, with_room
from phalanx.scenarios.file import find_scenario, written_scenario
from phalanx.scenarios.own import find_controller, find_planner, mistakes_in
from phalanx.scenarios.scenario import WHEELS, Scenario, for_robots

from .driver import AdvisedHardware, make_driver
from .far_planner import FarPlanner, is_far
from .kept_log import KeptLog
from .life import Life
from .on_air import HostileRadio, RadioAttack
from .sealed_air import SealedAir, may_send, with_room_for_seals
from .settings import RobotSettings
from .signed_mission import signed_for
from .state import EVERY_S, state_of, write_state
from .trusted import NodeClock, check_may_have_key, connect_nodes, provision_keys, start

log = logging.getLogger(__name__)


def mission_of(settings: RobotSettings) -> Scenario:
    """Return the scenario that the file names. Raises: UsageError, Unavailable."""
    scenario = mission_in(settings.base, settings.said.mission)
    if scenario.controller == WHEELS and settings.said.radio.group:
        raise UsageError("a group, for robots that obey orders", "use peers only: each would log the others' orders")
    return with_room_for_seals(scenario) if settings.said.radio.sealed else scenario


def mission_in(folder: Path, words: str) -> Scenario:
    """Return the scenario of that name, or in that file of the folder. Raises: UsageError, Unavailable."""
    scenario = for_robots(find_scenario(words if words in built_in("scenarios") else str(folder / words)))
    if scenario.controller == WHEELS and not (scenario.gateway_key and scenario.operator_key):
        raise UsageError(f"{words} has no gateway_key and operator_key", "add those of phalanx keys list")
    return scenario


def controlled(scenario: Scenario, settings: RobotSettings) -> tuple[Scenario, MakeController | None]:
    """Return the scenario with room for its controller's memory, and that one if it is a file. Raises: UsageError."""
    made: MakeController | None = None
    if settings.said.controller:
        words = str(settings.path(settings.said.controller))
        _, made = find_controller(words, scenario, in_python=True)
    scenario, made, _ = with_protocol(scenario, made)
    return with_room(scenario, made), made


def provision(settings: RobotSettings, keys_file: Path, passphrase: str, today: str) -> None:
    """Load the robot's limits and a master key from a key file into its nodes, over their line.

    The nodes are checked before the key is used up. The key is marked as used on disk before it is sent.
    Raises: UsageError: the nodes or the id already have a key, or a file is invalid; Unavailable: no answer.
    """
    check_may_have_key(settings)
    scenario, _ = controlled(mission_of(settings), settings)
    robot = settings.said.robot
    node = connect_nodes(settings)
    try:
        if node.about.robot_id:
            raise UsageError(f"its trusted nodes already belong to robot {node.about.robot_id}", "use a new board")
        with open_keyring(keys_file, passphrase) as keys:
            master = keys.provision(robot, today)
        node.make(limits_of(scenario.bti, scenario.radio), sealed=settings.said.radio.sealed)
        node.load_master(master, robot)
    except Refused as error:
        raise UsageError(f"its trusted nodes refuse: {error.reason}", "use another board") from error
    finally:
        node.close()


async def run_robot(
    settings: RobotSettings,
    *,
    in_arena: bool = False,
    on_air: RadioAttack | None = None,
    attacks: tuple[AttackSpec, ...] = (),
    make_base: Callable[[int, Scenario, Declaration], AdvisedHardware] | None = None,
) -> None:
    """Run the robot until cancelled; in Safe Mode it stands still and still publishes its state.

    Args:
        in_arena: an arena has forked this process, has warned about the nodes and has frozen its memory.
        attacks: attacks that replace the mission's.
        make_base: creates sensors, motors and planner, in place of those in the file.
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
            log.warning("robot %d: its trusted nodes are a process, no protection on this machine", said.robot)
        sealed = provision_keys(node, settings, limits)
        kept = stack.enter_context(KeptLog(settings.log_file))
        may = may_send(scenario, len(said.radio.peers), sealed=said.radio.sealed)
        radio: Radio = stack.enter_context(
            contextlib.closing(UdpRadio(said.radio.here, said.radio.peers, said.radio.group, may))
        )
        if on_air:
            log.warning("robot %d simulates an attack by its radio: %s", said.robot, on_air.name)
            radio = HostileRadio(radio, on_air, said.clock_speed)
        air = SealedAir(node, radio) if said.radio.sealed else None
        declared = declaration_of(scenario)
        base = make_base(said.robot, scenario, declared) if make_base else None
        hardware = base or make_driver(settings, declared)
        stack.callback(hardware.close)
        planner: MakePlanner | FarPlanner | None = base.planner if base else None
        if is_far(said.planner):
            planner = FarPlanner(said.planner, settings.base, scenario, said.robot, sealed.seq)
        elif said.planner:
            planner = find_planner(str(settings.path(said.planner)))
        clock, ears = NodeClock(air or node, said.clock_speed), air or radio
        with_attacks = replace(scenario, attacks=attacks) if attacks else scenario
        life = Life(with_attacks, said.robot, clock, hardware, ears, planner, controller, sealed.seq)
        stack.callback(life.close)
        if not in_arena:
            gc.collect()
            gc.freeze()  # collecting permanent objects takes longer than a reading may be late
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
            **({"signed": signed.as_json} if signed else {}),
        }
        kept.begin(head)
        own_files = () if in_arena else settings.own_files  # the arena reports errors in its own files
        await _live(life, kept, settings.state_file, base, own_files)


async def _live(
    life: Life, kept: KeptLog, state_file: Path, base: AdvisedHardware | None, own_files: tuple[str, ...]
) -> None:
    life_task = asyncio.create_task(life.live(kept))
    try:
        with mistakes_in(*own_files):
            await _publish_state(life, life_task, state_file, base)
    except asyncio.CancelledError:
        life.why_ended = "it was stopped by a signal"
        raise
    except Exception as error:
        life.why_ended = str(error) if isinstance(error, PhalanxError) else f"{type(error).__name__}: {error}"
        raise
    finally:
        life_task.cancel()
        await asyncio.gather(life_task, return_exceptions=True)
        with contextlib.suppress(Exception):
            write_state(state_file, state_of(life))


async def _publish_state(
    life: Life, life_task: asyncio.Task[None], state_file: Path, base: AdvisedHardware | None
) -> None:
    last_error = ""
    while True:
        state = state_of(life)
        if base:
            base.tell(state)
        try:
            await asyncio.to_thread(write_state, state_file, state)  # in a thread: a slow disk must not delay readings
            last_error = ""
        except Unavailable as error:  # continue with a full disk
            if str(error) != last_error:
                log.warning("%s", error)
            last_error = str(error)
        await asyncio.wait([life_task], timeout=EVERY_S)
        if life_task.done():
            await life_task
            await asyncio.sleep(EVERY_S)  # in Safe Mode: keep publishing the state
