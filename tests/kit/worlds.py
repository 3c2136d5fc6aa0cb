"""A world of points for walkers: whoever stands near enough sees every landmark of the plain mission, as it is."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Experience,
    Landmark,
    Mission,
    Phase,
    Position,
    Profile,
    Sensor,
    State,
    Walker,
    build,
)

# scrypt at a cost that a test can pay thousands of times; the format is the same.
CHEAP = CodingConfig(delta_mm=400, kdf_log2_n=1, kdf_r=1)
CONFIG = MissionConfig()
BOTH = (Profile.PAPER, Profile.SEALED)


def draws(seed: object = 0):
    """A source of "random" bytes that gives the same again."""
    count = 0

    def random(size: int) -> bytes:
        nonlocal count
        count += 1
        return hashlib.shake_256(f"{seed} {count}".encode()).digest(size)

    return random


def corridor(nodes: int = 6, *, step_m: float = 4.0, coding: CodingConfig | None = None, **more) -> Mission:
    """A chain of doorways along a line, each with an action; the last is final."""
    draft = Draft("corridor", coding=coding, **more)
    draft.node("n0", Position(0.0, 0.0), start=True)
    for i in range(1, nodes):
        draft.node(
            f"n{i}",
            Landmark("doorway", i * step_m, 0.37 * i, 0.1 * i),
            do=Action("pick", (("shelf", i),)),
            final=i == nodes - 1,
        )
        draft.way(f"n{i - 1}", f"n{i}")
    return draft.mission()


def built(mission: Mission, profile: Profile, seed: object = 0, **options):
    """One part, built."""
    (one,) = build(mission, BuildOptions(profile=profile, **options), draws(seed))
    return one


def cheap(mission: Mission, profile: Profile) -> Mission:
    return replace(mission, coding=mission.coding or CHEAP) if profile is Profile.SEALED else mission


def truths(mission: Mission) -> list[Landmark]:
    return [thing for node in mission.nodes for alias in node.see for thing in alias if isinstance(thing, Landmark)]


def pool(mission: Mission) -> tuple[Action, ...]:
    """Every action of a mission, and one more: a robot's pool."""
    actions = [node.do for node in mission.nodes if node.do] + [way.do for way in mission.ways if way.do]
    return tuple(dict.fromkeys([*actions, Action("idle")]))


def at(mission: Mission, x_m: float, y_m: float, t_s: float, *, range_m: float = 6.0, **more) -> Experience:
    """What is experienced at a place, with perfect senses."""
    seen = tuple(
        landmark for landmark in truths(mission) if math.hypot(landmark.x_m - x_m, landmark.y_m - y_m) <= range_m
    )
    defaults = {"travelled_m": 0.5 * t_s, "landmarks": seen, "actions": pool(mission)}
    return Experience(t_s, x_m, y_m, 0.0, **(defaults | more))


def walk(mission: Mission, walker: Walker, *, places=None, steps_each: int = 30, range_m: float = 6.0, state=None):
    """Stand at each place for some steps; yields (state, outcome) of every step. Default: at the nodes, in order."""
    state = state or State()
    places = places or [node.place for node in mission.nodes if node.place is not None]
    t_s = 0.0
    for x_m, y_m in places:
        for _ in range(steps_each):
            t_s += 0.1
            state, outcome = walker.step(state, at(mission, x_m, y_m, t_s, range_m=range_m))
            yield state, outcome
            if outcome.decoded is None and outcome.reason is not None and outcome.reason.value == "no match":
                break


def explored(mission: Mission, walker: Walker, *, told: tuple[bytes, ...] = (), vain: int = 6):
    """Go where the walker says, until it is done or holds; yields (state, outcome) of every step.

    After some steps in vain the time-out goes by. What nodes send is heard; `told` is what a controller says.
    """
    things = [thing for node in mission.nodes for alias in node.see for thing in alias]
    sensors = tuple(dict.fromkeys(thing.value for thing in things if isinstance(thing, Sensor)))
    (x, y), *_ = (node.place for node in mission.nodes if node.start)
    state, t_s, travelled, waited, heard = State(), 0.0, 0.0, 0, told
    while state.phase in (Phase.SEEKING, Phase.RETURNING):
        t_s += 0.1 if waited < vain else 1 + walker.config.timeout_s
        senses = at(mission, x, y, t_s, travelled_m=travelled, messages=heard, sensors=sensors)
        state, outcome = walker.step(state, senses)
        yield state, outcome
        waited = 0 if outcome.event else waited + 1
        heard += outcome.decoded.sends if outcome.decoded else ()
        there = outcome.order.target is not None and mission.nodes[outcome.order.target].place
        if there:
            travelled += math.dist((x, y), there)
            x, y = there


def decoded_of(steps) -> list[tuple]:
    """(node, what to do, directions on) of everything that was decoded."""
    return [
        (o.decoded.node, o.decoded.do, tuple((way.target, way.direction_rad, way.do) for way in o.decoded.ways))
        for _, o in steps
        if o.decoded is not None
    ]


def walker_of(one, config: MissionConfig | None = None) -> Walker:
    return Walker(one.mission, one.key, config or CONFIG)


def fork() -> Draft:
    """start → left or right → end."""
    draft = Draft("fork")
    draft.node("start", Position(0, 0), start=True, timeout_s=5)
    draft.node("left", Landmark("doorway", 4, 3, 0.2))
    draft.node("right", Landmark("doorway", 5, -3, 0.4))
    draft.node("end", Landmark("doorway", 9, 0, 0.0), final=True)
    for side in ("left", "right"):
        draft.way("start", side, both=True)
        draft.way(side, "end")
    return draft


def walker_for(draft: Draft, profile: Profile, config: MissionConfig = CONFIG, **options) -> Walker:
    return walker_of(built(cheap(draft.mission(), profile), profile, **options), config)


def leading_to(*see, **more) -> Draft:
    """start → a final node that is seen so."""
    draft = Draft("short")
    draft.node("start", Position(0, 0), start=True)
    draft.node("end", *see, final=True, **more)
    draft.way("start", "end")
    return draft


def at_start(draft: Draft, profile: Profile, config: MissionConfig = CONFIG) -> tuple[Walker, State]:
    """A walker, and its state when it has seen the start."""
    walker = walker_for(draft, profile, config)
    return walker, walker.step(State(), Experience(0, 0, 0, 0))[0]


def until_decoded(walker, state, seen, steps: int = 40):
    """The same experience until something decodes."""
    for i in range(steps):
        state, outcome = walker.step(
            state, replace(seen, t_s=seen.t_s + 0.1 * i, messages=seen.messages if not i else ())
        )
        if outcome.decoded:
            return state, outcome
    return state, outcome


EVERYTHING = """
mission: everything
map: office_40x40
area: [0, 0, 40, 40]
repeatable: true
coding: {delta_mm: 200, kdf_log2_n: 1, kdf_r: 1}
nodes:
  start: {start: true, see: {position: [3.0, 1.5]}}
  door: {see: {doorway: [9, 12], facing: 90}, width: 2.0, do: {pick: {shelf: 3, from: top}}, within_m: 2}
  room: {see: [{room: [12.5, 3.5], area: 52.5}, {room: [16, 3.5], area: 52.5}], timeout_s: 30, send: lit}
  code: {see: {qr: [1, 2], facing: -90, text: shelf 3}, do: stop}
  noon: {see: {position: [5, 5], sensor: [red, warm], time: 1000}, wait: [go], final: true}
ways:
  - [start, door, room]
  - {from: room, to: [code, noon], direction: 45}
  - {from: code, to: noon, do: {lift: {floor: 2}}}
"""
