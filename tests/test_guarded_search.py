"""Guarded robots never touch each other or a fence, whatever their planners want: a search for one that does.

Worlds are drawn: fences with a corner that points in, places to keep out of, envelopes, starts; lost and late
broadcasts; readings and commands that are off by up to δ. So are the planners, which aim at harm.
"""

from __future__ import annotations

import numpy as np
import pytest

from guarded_world import World, state
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
    ways = []
    for ax, ay, bx, by in world.config.walls():
        a, b = np.array((ax, ay)), np.array((bx, by))
        share = np.clip((world.pos[i] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        ways.append(a + share * (b - a) - world.pos[i])
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


PLANS = (at_robots, at_walls, anywhere, by_turns)


def drawn(seed, **more):
    """A world of four robots, its planners drawn too."""
    chance = np.random.default_rng(seed)
    config = GuardConfig(
        fences=(FENCE,),
        keep_out=(TRIANGLE,),
        discs=(Disc(x_m=6.0, y_m=-8.0, radius_m=1.0),),
        apart_m=APART_M,
        clear_m=CLEAR_M,
        speed_mps=float(chance.uniform(0.6, 4.0)),
        accel_mps2=float(chance.uniform(0.3, 2.5)),
        forget_ms=2500,
        state_every=2,
    )
    places = []
    while len(places) < 4:
        place = tuple(map(float, chance.uniform(-15, 15, 2)))
        try:
            config.check_start(place)
        except UsageError:
            continue
        if all(np.hypot(place[0] - x, place[1] - y) > APART_M for x, y in places):
            places.append(place)
    plan = PLANS[seed % len(PLANS)]
    return World(config, places, chance, plan, off=float(chance.choice((0.0, 1.0))), **more)


def is_kept(world):
    """Whether no robot was ever too near to another or a wall, or too fast."""
    kept = world.nearest >= APART_M - ROUNDED_M and world.at_wall >= CLEAR_M - ROUNDED_M
    return kept and world.fastest <= world.config.speed_mps * (1 + 1e-6)


def harm(seeds, seconds=20):
    return [(seed, w.nearest, w.at_wall, w.fastest) for seed in seeds if not is_kept(w := drawn(seed).run(seconds))]


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
