"""One robot outside of the simulator: the same events give the same log, and nothing else is due."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phalanx.bti import request as audits
from phalanx.bti.fleet import make_fleet
from phalanx.bti.log import logged
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.config.radio import RadioConfig
from phalanx.robot.actions import RetryAt, Transmit
from phalanx.robot.controllers import dispatch
from phalanx.robot.planner import ToGoal, advice_of
from phalanx.robot.robot import Robot
from phalanx.robot.runtime import Runtime
from phalanx.wire.fields import row
from phalanx.world import Scenario
from phalanx.world.audited import loop, pybot
from phalanx.world.scenarios.run import Run

SWARM = Scenario(
    robots=6, grid_step_m=16.0, goal_m=(60.0, 60.0), duration_s=16.0, controller="guard", bti=BtiConfig(f_max=1)
)
# Who hears a tenth of what is said lacks tokens at times, and listens before its next round. Retries draw airtime from
# its a-node, and a robot by itself has no radio that retries: so there is enough for all.
LOSSY = replace(SWARM, radio=RadioConfig(loss=0.9), n_max=200)
ME = 2
NAMES = {loop.CONTROL: "reading", loop.MESSAGE: "packet", loop.SENT: "sent"}


def alone(run):
    """The robot by itself, with its own trusted nodes as they are now."""
    world, settings = run.world, run.world.fleet.settings[0]
    fleet = make_fleet(
        1,
        run.scenario.bti,
        world.fleet.params,
        profile=int(settings.profile),
        controller=int(settings.controller),
        mission_seed=int(settings.mission_seed),
        snode=world.fleet.snode[ME : ME + 1].copy(),
        anode=world.fleet.anode[ME : ME + 1].copy(),
    )
    fleet.robot["id"] = ME + 1
    return fleet, make_work(run.scenario.bti)


@pytest.fixture(scope="module", params=[SWARM, LOSSY], ids=["heard", "lossy"])
def lived(request):
    """A run in which somebody noted all that one robot was told from outside, and what it then had in its log."""
    noted, handle, no_room, full = [], pybot.handle, audits.postpone, []

    def was_full(fleet, i, now_ms):
        if i == ME:
            full.append(now_ms)
        return no_room(fleet, i, now_ms)

    def note(world, robots, *advice_and_stage):
        kind = int(world.clock[0].kind)
        mine = int(world.clock[0].robot) == ME
        if mine and kind in NAMES:
            raw = world.reading if kind == loop.CONTROL else world.packet
            data = raw[: world.packet_len[0]].tobytes() if kind != loop.SENT else bool(world.clock[0].arg)
            noted.append((int(world.clock[0].now_us + world.boot_us[ME]) // 1000, NAMES[kind], data))
        handle(world, robots, *advice_and_stage)
        if mine:
            noted.append((None, "log", (logged(world.fleet, ME), full.copy())))
            full.clear()

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(pybot, "handle", note)
        patched.setattr(loop, "carry_out", loop.carry_out.py_func)
        patched.setattr(audits, "postpone", was_full)
        run = Run(request.param)
        robot, boot_ms = alone(run), int(run.world.boot_us[ME]) // 1000
        run.advance(SWARM.duration_s)
    return robot, boot_ms, noted, run


def test_the_same_run_fed_to_one_robot_alone_gives_the_same_log_bytes(lived):
    (fleet, work), boot_ms, noted, run = lived
    runtime = Runtime(Robot(fleet, 0, work), run.scenario.bti, boot_ms)
    planner = ToGoal(ME + 1, SWARM.goal_m)
    logs = iter([data for _, kind, data in noted if kind == "log"])
    compared = packets = waits = 0

    def same():
        nonlocal compared
        right, was_full = next(logs)
        for now_ms in was_full:
            runtime._kept(now_ms, [RetryAt(audits.postpone(fleet, 0, now_ms))])
        assert logged(fleet, 0) == right
        compared += 1

    def rounds_due():
        return len(runtime._rounds)

    for at_ms, kind, data in noted:
        if kind == "log":
            continue
        while runtime.audit_ms <= at_ms:
            before = rounds_due()
            runtime.on_audit(runtime.audit_ms)
            waits += rounds_due() > before
            same()
        if kind == "reading":
            assert runtime.input_ms == at_ms
            runtime.on_reading(at_ms, data, advice_of(planner, at_ms, data))
        elif kind == "packet":
            runtime.on_packet(at_ms, data)
            packets += 1
        else:
            runtime.on_sent(at_ms, arrived=data)
        same()
    assert (waits > 0) == (run.scenario.radio.loss > 0)
    assert packets > (10 if waits else 50)
    assert compared > (50 if waits else 150)
    assert fleet.robot[0].tokens_got == run.world.fleet.robot[ME].tokens_got > 0
    np.testing.assert_array_equal(fleet.hckpt[0], run.world.fleet.hckpt[ME])


def test_a_robot_that_nobody_answers_is_stopped_when_its_tokens_have_run_out():
    run = Run(SWARM)
    (fleet, work), boot_ms = alone(run), int(run.world.boot_us[ME]) // 1000
    runtime = Runtime(Robot(fleet, 0, work), run.scenario.bti, boot_ms)
    asked = 0
    while not runtime.in_safe_mode:
        now_ms = runtime.due_ms
        if runtime.check_ms == now_ms:
            runtime.on_check(now_ms)
        elif runtime.audit_ms == now_ms:
            sent = [row(each.packet) for each in runtime.on_audit(now_ms) if isinstance(each, Transmit)]
            asked += sum(audits.is_fragment(each, len(each)) for each in sent)
        else:
            runtime.on_reading(now_ms, b"\x02" + bytes(26))
        assert now_ms <= boot_ms + SWARM.bti.t_val_ms + 2 * SWARM.bti.p_check_ms
    assert now_ms >= boot_ms + SWARM.bti.t_val_ms
    assert asked == 0, "it knows nobody whom it could ask"
    assert runtime.on_reading(now_ms, b"\x02" + bytes(26)) == []


def test_no_frame_makes_it_raise():
    run = Run(SWARM)
    (fleet, work), boot_ms = alone(run), int(run.world.boot_us[ME]) // 1000
    runtime = Runtime(Robot(fleet, 0, work), run.scenario.bti, boot_ms)
    chance = np.random.default_rng(5)
    for k in range(2000):
        length = int(chance.integers(0, 2100))
        packet = chance.bytes(length)
        runtime.on_packet(boot_ms + k, (b"\x80" + packet[1:] if k % 2 else packet))
    assert dispatch.NUMBERS["guard"] == fleet.settings[0].controller
