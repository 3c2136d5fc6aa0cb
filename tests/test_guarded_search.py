"""Guarded robots never touch each other or a fence, whatever their planners want: a search for one that does.

Worlds are drawn: fences with a corner that points in, places to keep out of, envelopes, starts; lost and late
broadcasts; readings and commands that are off by up to δ. So are the planners, which aim at harm.
"""

from __future__ import annotations

import numpy as np
import pytest

from guarded_world import MOTION, World, acceleration, reading, state, wish
from phalanx.config.flock import Disc
from phalanx.config.guard import GuardConfig
from phalanx.errors import UsageError

pytestmark = pytest.mark.long

FENCE = ((-15.0, -15.0), (15.0, -15.0), (15.0, 15.0), (0.0, 4.0), (-15.0, 15.0))
TRIANGLE = ((-4.0, -4.0), (-1.0, -4.0), (-1.0, -1.0))
APART_M, CLEAR_M = 0.8, 0.4
# What bodies' rounding to f32 leaves.
ROUNDED_M = 1e-4


def nearest(vectors):
    return vectors[np.argmin(np.hypot(*np.array(vectors).T))]


def at_robots(world, i):
    """Full speed at whoever is nearest."""
    there = np.delete(world.pos, i, axis=0) - world.pos[i]
    return 99 * nearest(there)


def at_walls(world, i):
    """At the nearest wall, along it, or away, as chance has it."""
    ways = [world.ways_to(wall)[i] for wall in world.config.walls()]
    x, y = 9 * nearest(ways)
    return ((x, y), (x, y), (-x, -y), (y, -x))[world.chance.integers(4)]


def anywhere(world, _i):
    """What a bad policy says: anything, nothing, or no number."""
    kind = world.chance.integers(8)
    return None if kind == 0 else (np.nan, 1.0) if kind == 1 else tuple(world.chance.normal(0, 3, 2))


def by_turns(world, i):
    """Now at one thing, now at another, for a second or two each."""
    turn = int(world.now / (700 + 300 * i)) % 3
    return (at_robots, at_walls, anywhere)[turn](world, i)


def to_and_fro(world, i):
    """Another way at each reading: what a command that is late makes the most of."""
    x, y = 9 * world.config.speed_mps * nearest(np.delete(world.pos, i, axis=0) - world.pos[i])
    return (x, y) if int(world.now / world.config.period_ms) % 2 else (-x, -y)


def at_the_unheard(world, i):
    """At whoever this robot has heard least lately: where it knows least."""
    ages = np.where(np.arange(len(world.pos)) == i, np.inf, world.heard[i])
    return tuple(9 * (world.pos[np.argmin(ages)] - world.pos[i]))


def at_corners(world, i):
    """At a corner, of a fence that points in most of all."""
    corners = np.array([corner for polygon in (*world.config.fences, *world.config.keep_out) for corner in polygon])
    return tuple(9 * (corners[(i + int(world.now / 5000)) % len(corners)] - world.pos[i]))


def sly(world, i):
    """Of ten wishes the one whose command brings it nearest to whatever it must not touch: it knows the guard."""
    this, other = world.robots[i], world.others[i]
    t, found = int(world.now), (-np.inf, None)
    targets = np.delete(world.pos, i, axis=0) - world.pos[i]
    ways = [world.ways_to(wall)[i] for wall in world.config.walls()]
    goal = nearest([*targets, *ways])
    goal = goal / max(1e-9, np.hypot(*goal))
    for turn in np.linspace(-1.5, 1.5, 5):
        for speed in (world.config.speed_mps, 0.2 * world.config.speed_mps):
            wished = (
                speed * (goal[0] * np.cos(turn) - goal[1] * np.sin(turn)),
                speed * (goal[0] * np.sin(turn) + goal[1] * np.cos(turn)),
            )
            other.decode(this.encode())
            other.on_advice(wish(*wished))
            done = acceleration(other.on_input(1, t, reading(i + 1, world.pos[i], world.vel[i], t)))
            found = max(found, (float(np.dot(done, goal)), wished))
    return found[1]


PLANS = (at_robots, at_walls, anywhere, by_turns, to_and_fro, at_the_unheard, at_corners, sly)
L_SHAPED = ((0.0, 0.0), (12.0, 0.0), (12.0, 3.0), (3.0, 3.0), (3.0, 12.0), (0.0, 12.0))


def places_in(config, chance, count, side):
    """As many places where robots may stand, drawn."""
    places = []
    while len(places) < count:
        place = tuple(map(float, chance.uniform(*side, 2)))
        try:
            config.check_start(place)
        except UsageError:
            continue
        if all(np.hypot(place[0] - x, place[1] - y) > config.apart_m for x, y in places):
            places.append(place)
    return places


def drawn(seed, **more):
    """A world, its robots and its planners, all drawn; of four one is a narrow fence with five robots."""
    chance = np.random.default_rng(seed)
    narrow = chance.integers(4) == 0
    config = GuardConfig(
        fences=(L_SHAPED,) if narrow else (FENCE,),
        keep_out=() if narrow else (TRIANGLE,),
        discs=() if narrow else (Disc(x_m=6.0, y_m=-8.0, radius_m=1.0),),
        apart_m=APART_M,
        clear_m=CLEAR_M,
        speed_mps=float(chance.uniform(0.6, 4.0)),
        accel_mps2=float(chance.uniform(0.3, 2.5)),
        turn_radps=(0.0, 0.4, 2.0)[seed % 3],
        promise_ms=int(chance.integers(500, 6000)),
        forget_ms=2500,
        state_every=int(chance.integers(1, 4)),
    )
    places = places_in(config, chance, 5 if narrow else 4, (0, 12) if narrow else (-15, 15))
    loss = float(chance.choice((0.0, 0.2, 0.95)))  # at the last only what the guard counts on is heard
    return World(
        config, places, chance, PLANS[seed % len(PLANS)], off=float(chance.choice((0.0, 1.0))), loss=loss, **more
    )


def is_kept(world):
    """Whether no robot was ever too near to another or a wall, or too fast, turned too sharply, or broke its word."""
    config = world.config
    kept = world.nearest >= config.apart_m - ROUNDED_M and world.at_wall >= config.clear_m - ROUNDED_M
    kept = kept and world.sharpest <= 1 + ROUNDED_M
    return kept and world.fastest <= config.speed_mps * (1 + 1e-6) and world.broken <= ROUNDED_M


def harm(seeds, seconds=20):
    return [
        (seed, w.nearest, w.at_wall, w.fastest, w.sharpest, w.broken)
        for seed in seeds
        if not is_kept(w := drawn(seed).run(seconds))
    ]


def test_no_advice_leads_robots_into_each_other_or_through_a_fence():
    assert harm(range(8)) == []


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_nor_in_a_thousand_worlds():
    assert harm(range(8, 1008)) == []


def test_robots_that_simply_obey_do_all_of_it():
    worlds = [drawn(seed, obeys=False).run(20) for seed in range(3)]
    assert any(world.nearest < APART_M for world in worlds)
    assert any(world.at_wall < CLEAR_M for world in worlds)


def looks(world, i):
    """To its goal, slower near it, and to the right around whoever is near: an honest planner that looks."""
    to = world.goals[i] - world.pos[i]
    wished = to * min(0.5, 2.0 / max(1e-9, np.hypot(*to)))
    for gap in np.delete(world.pos, i, axis=0) - world.pos[i]:
        far = np.hypot(*gap)
        if far < 6.0:
            push = 2.5 * (1.0 - far / 6.0)
            wished = wished - push * gap / far
            if gap @ to > 0:
                wished = wished + 0.6 * push * np.array((gap[1], -gap[0])) / far
    return tuple(wished)


def came(seed, plan, seconds, obeys=True, **envelope):
    """Of nine robots that change places: after how many seconds each was first at its goal; and the world."""
    chance, grid = np.random.default_rng(seed), [(8.0 * x, 8.0 * y) for x in range(3) for y in range(3)]
    world = World(GuardConfig(**envelope), grid, chance, plan, obeys=obeys)
    order = chance.permutation(9)
    while (order == np.arange(9)).any():
        order = chance.permutation(9)
    world.goals, after = np.array(grid)[order], np.full(9, np.inf)
    for second in range(1, seconds + 1):
        at = np.hypot(*(world.run(second).pos - world.goals).T) < 1.0
        after = np.where(at & np.isinf(after), second, after)
        if at.all():
            break
    return after, world


def test_nine_that_look_where_they_go_change_places_under_the_guard():
    after, world = came(0, looks, 150)
    assert is_kept(world)
    assert np.isfinite(after).all()
    alone, _ = came(0, looks, 30, obeys=False)
    print(f"median time to the goal: {np.median(after):.0f} s guarded, {np.median(alone):.0f} s without")
    assert np.median(after) < 7 * np.median(alone)


def test_guarded_robots_move():
    moved = []
    for seed in range(2):
        world = drawn(seed)
        starts = world.pos.copy()
        moved.append(np.hypot(*(world.run(20).pos - starts).T).mean())
    assert np.mean(moved) > 1.0


class Spoken(World):
    """A world in which somebody speaks in another's name, as often as a radio lets it."""

    def read(self, i, step):
        super().read(i, step)
        if i == 0:
            other = int(self.chance.integers(1, len(self.robots)))
            place = self.pos[other] + self.chance.normal(0, 6, 2)
            for j in range(1, len(self.robots)):
                if j != other:
                    self.push(self.now + 1, "hear", j, state(other + 1, place))


def test_who_speaks_in_anothers_name_makes_robots_stand_and_not_collide():
    for seed in range(0, 12, 4):
        world = drawn(seed)
        liar = Spoken(world.config, world.places, np.random.default_rng(seed), at_robots)
        assert is_kept(liar.run(20)), seed


class Elsewhere(World):
    """A world in which the first robot says, in its own name, that it is 5 m beside where it is."""

    honest = np.inf  # how near two of the others came

    def broadcast(self, i, packet):
        if i == 0:
            _, rob, t, x, y, *promised = MOTION.unpack(packet)
            packet = state(rob, (x + 5.0, y), promised, t)
        super().broadcast(i, packet)

    def look_at_promises(self):
        super().look_at_promises()
        others = self.pos[1:]
        if len(others) > 1:
            gaps = np.sqrt(((others[:, None] - others) ** 2).sum(axis=2))
            self.honest = min(self.honest, gaps[~np.eye(len(others), dtype=bool)].min())


def test_who_lies_about_its_own_place_may_be_run_into_and_the_others_keep_clear_of_each_other():
    nearest = np.inf
    for seed in (0, 4):
        world = drawn(seed)
        liar = Elsewhere(world.config, world.places, np.random.default_rng(seed), at_robots).run(20)
        assert liar.honest >= world.config.apart_m - ROUNDED_M, seed
        nearest = min(nearest, liar.nearest - world.config.apart_m)
    assert nearest < 0, "what does not hold: nobody keeps clear of who is not where it says"
