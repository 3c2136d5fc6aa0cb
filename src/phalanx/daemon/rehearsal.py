"""Two robots in this process that audit each other, before the mission begins: all that is compiled is found or made.

From the mission key on a reading is due each quarter of a second, and nothing may take longer than δ.
"""

from __future__ import annotations

from phalanx.bti.fleet import BOUND, make_fleet
from phalanx.bti.nodes import Limits, Nodes, seal_mission_key
from phalanx.bti.work import make_work
from phalanx.robot.cnode import Actuate, CNode, Transmit, Verdict
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.protocol import find_protocol
from phalanx.robot.controllers.python_controller import compiled
from phalanx.robot.planner import advice_of
from phalanx.robot.runtime import Runtime, is_fragment
from phalanx.sim.scenarios.run import MakeController, adviser, driving, number_of, params_of
from phalanx.sim.scenarios.scenario import Scenario
from phalanx.wire.table import KEY_BYTES

BEGAN_MS = 1000


def rehearse(scenario: Scenario, limits: Limits, controller: MakeController | None = None) -> int:
    """How many audits ended well, of two robots that stand where a mission begins; all that runs has run once."""
    config, declared = scenario.bti, driving(scenario)
    protocol, senses = find_protocol(scenario.controller), getattr(controller, "senses", None)
    seen = bytes(protocol.stage.seen_bytes if protocol else senses.size if senses else 0)
    nodes = Nodes(2, BOUND, limits)
    master = bytes(KEY_BYTES)
    for i in range(2):
        nodes.load_master(i, master, i + 1)
        nodes.load_mission(i, BEGAN_MS, seal_mission_key(master, bytes(KEY_BYTES), bytes(KEY_BYTES), 1))
    fleet = make_fleet(
        2,
        config,
        params_of(scenario),
        profile=BOUND,
        controller=number_of(scenario, controller),
        mission_seed=scenario.seed,
        snode=nodes.snode,
        anode=nodes.anode,
    )
    work = make_work(config)
    robots = [Runtime(CNode(fleet, i, work, controller), config, BEGAN_MS) for i in range(2)]
    make = adviser(scenario, controller)
    planners = [make(i + 1, scenario.goal_m) for i in range(2)] if make else []
    if scenario.attacks and not controller:
        _as_liars_know(scenario)
    passed = 0
    # Two rounds each: the second begins at a checkpoint.
    end_ms = BEGAN_MS + 3 * config.t_audit_ms
    while (now_ms := min(each.due_ms for each in robots)) < end_ms:
        i = min(range(2), key=lambda which: robots[which].due_ms)
        me, other = robots[i], robots[1 - i]
        if me.check_ms == now_ms:
            me.on_check(now_ms)
            continue
        if me.input_ms == now_ms:
            reading = _reading(declared, i, now_ms) + seen
            todo = me.on_input(now_ms, reading, advice_of(planners[i], now_ms, reading) if planners else b"")
        else:
            todo = me.on_audit(now_ms)
        queue = [(me, other, each) for each in todo]
        while queue:
            speaker, hearer, done = queue.pop(0)
            if isinstance(done, Transmit):
                queue += [(hearer, speaker, each) for each in hearer.on_frame(now_ms, done.frame)]
                if is_fragment(done.frame):
                    queue += [(speaker, hearer, each) for each in speaker.on_sent(now_ms, arrived=True)]
            elif isinstance(done, Verdict):
                passed += done.refusal == 0
            else:
                assert isinstance(done, Actuate)
    return passed


def _reading(declared: Declaration, i: int, now_ms: int) -> bytes:
    apart = {each.name: 10.0 * i for each in declared.reads.fields if each.name not in ("id", "t")}
    return declared.reads.encode(id=i + 1, t=now_ms, **apart)


def _as_liars_know(scenario: Scenario) -> None:
    """A bundled controller beside a liar, which compares itself with it, has said and heard something."""
    honest = compiled(dispatch.NUMBERS[scenario.controller], params_of(scenario))(1)
    declared = dispatch.BUNDLED[scenario.controller]
    honest.on_recv(BEGAN_MS, bytes(declared.says.size))
    honest.on_advice(b"")
    honest.on_input(0, BEGAN_MS, _reading(declared, 0, BEGAN_MS))
    honest.decode(honest.encode())
