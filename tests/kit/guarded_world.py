"""A small world in which guarded robots meet whatever time and radio may do to them, for searching.

Unlike the simulator's it draws, for every reading and command, how far off its grid it is and how late, up to δ; and for
every broadcast whether it is lost and how long it takes. Bodies are exact between two moments; distances are looked at
each 10 ms.
"""

from __future__ import annotations

import heapq
import struct
from dataclasses import dataclass, field

import numpy as np

from phalanx.config.guard import GuardConfig
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.guard_law import guard_params
from phalanx.robot.controllers.python_controller import Act

MOTION = struct.Struct("<BHQ4f")
COMMAND = struct.Struct("<BHQ2f")
WISH = struct.Struct("<B2f")
LOOK_MS = 10


def reading(rob, place, velocity, t=0):
    return MOTION.pack(0x02, rob, t, *place, *velocity)


def state(rob, place, velocity=(0.0, 0.0), t=0):
    return MOTION.pack(0x01, rob, t, *place, *velocity)


def wish(x, y):
    return WISH.pack(0x0C, x, y)


def guard(config, rob=1):
    return compiled(dispatch.NUMBERS["guard"], guard_params(config))(rob)


def acceleration(outputs):
    (payload,) = (output.payload for output in outputs if isinstance(output, Act))
    return COMMAND.unpack(payload)[3:]


def sharpness(config, velocity, command):
    """How fast a command turns a velocity before the next is in force, as a share of what the envelope allows."""
    if config.turn_radps == 0.0 or np.hypot(*velocity) <= 0.05 * config.speed_mps:
        return 0.0
    across = abs(velocity[0] * command[1] - velocity[1] * command[0])
    held_s = (config.period_ms + 3 * config.delta_ms) / 1000
    slowest_s = np.clip(-(velocity @ command) / max(1e-12, command @ command), 0.0, held_s)
    slowest = velocity + slowest_s * command
    # What rounding to f32 leaves: of brakes, which turn nothing, it is all there is.
    return max(0.0, across - 1e-6 * np.hypot(*velocity)) / max(1e-12, config.turn_radps * (slowest @ slowest))


@dataclass
class World:
    """N robots at rest at `places`, their clocks alike; `plan(world, i)` is the wish of robot i, or None."""

    config: GuardConfig
    places: list[tuple[float, float]]
    chance: np.random.Generator
    plan: object
    loss: float = 0.2
    off: float = 1.0  # share of δ by which readings and commands may be off
    obeys: bool = True  # whether robots are guarded at all
    pos: np.ndarray = field(init=False)
    grids: np.ndarray = field(init=False)

    def __post_init__(self):
        n = len(self.places)
        self.pos, self.vel, self.acc = np.array(self.places, float), np.zeros((n, 2)), np.zeros((n, 2))
        self.robots = [guard(self.config, i + 1) for i in range(n)]
        self.others = [guard(self.config, i + 1) for i in range(n)]  # for planners that try before they wish
        self.heard = np.zeros((n, n))
        self.nearest, self.fastest, self.events, self.now, self.order = np.inf, 0.0, [], 0.0, 0
        self.at_wall, self.said, self.broken, self.sharpest = np.inf, [], 0.0, 0.0
        self.grids = 1000.0 + self.chance.uniform(0, self.config.period_ms, n)
        for i in range(n):
            self.push(self.grids[i], "read", i, 0)

    def push(self, at, *event):
        self.order += 1
        heapq.heappush(self.events, (at, self.order, *event))

    def late(self):
        return self.off * self.chance.uniform(0, self.config.delta_ms)

    def advance(self, to):
        while self.now < to:
            step = min(LOOK_MS, to - self.now)
            dt = step / 1000
            self.pos += dt * (self.vel + 0.5 * dt * self.acc)
            self.vel += dt * self.acc
            self.now += step
            apart = self.pos[:, None] - self.pos
            gaps = np.sqrt((apart**2).sum(axis=2)) + np.where(np.eye(len(self.pos)), np.inf, 0)
            self.nearest = min(self.nearest, gaps.min())
            self.fastest = max(self.fastest, np.sqrt((self.vel**2).sum(axis=1)).max())
            self.look_at_promises()
        self.at_wall = min(self.at_wall, self.wall())

    def look_at_promises(self):
        """By how much anybody is outside of what it said of its velocity (docs/guides/guard.md), m/s."""
        self.said = [each for each in self.said if each[0] >= self.now]
        if self.said:
            _, robots, said = zip(*self.said, strict=True)
            off = self.vel[list(robots)] - 0.5 * np.array(said)
            wide = 0.8 * np.sqrt((np.array(said) ** 2).sum(axis=1)) + 0.01 * self.config.speed_mps
            self.broken = max(self.broken, (np.sqrt((off**2).sum(axis=1)) - wide).max())

    def wall(self):
        """How near the nearest robot is to a wall or disc."""
        near = np.inf
        for wall in self.config.walls():
            near = min(near, np.sqrt((self.ways_to(wall) ** 2).sum(axis=1)).min())
        for disc in self.config.discs:
            near = min(near, np.hypot(*(self.pos - (disc.x_m, disc.y_m)).T).min() - disc.radius_m)
        return near

    def ways_to(self, wall):
        """From each robot to the nearest point of a wall."""
        a, b = np.array(wall).reshape(2, 2)
        share = np.clip((self.pos - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return a + share[:, None] * (b - a) - self.pos

    def run(self, seconds):
        end = 1000 + seconds * 1000
        while self.events and self.events[0][0] <= end:
            at, _, kind, i, what = heapq.heappop(self.events)
            self.advance(at)
            getattr(self, kind)(i, what)
        return self

    def read(self, i, step):
        t = int(self.now)
        wished = self.plan(self, i)
        if wished is not None:
            self.robots[i].on_advice(wish(*wished))
        outputs = self.robots[i].on_input(step, t, reading(i + 1, self.pos[i], self.vel[i], t))
        if self.obeys:
            command = acceleration(outputs)
            self.sharpest = max(self.sharpest, sharpness(self.config, self.vel[i], np.array(command)))
        else:  # as a robot that simply obeys: no faster and no harder than the others
            to = np.array(wished if wished is not None else (0.0, 0.0))
            to *= min(1.0, self.config.speed_mps / max(1e-9, np.hypot(*to)))
            command = to - self.vel[i]
            command *= self.config.accel_mps2 / max(self.config.accel_mps2, np.hypot(*command))
        self.push(self.now + self.late(), "obey", i, tuple(command))
        for output in outputs:
            if not isinstance(output, Act):
                self.broadcast(i, output.payload)
        due = self.grids[i] + (step + 1) * self.config.period_ms + self.chance.choice((-1, 1)) * self.late()
        self.push(due, "read", i, step + 1)

    def obey(self, i, command):
        self.acc[i] = command

    def broadcast(self, i, packet):
        said = MOTION.unpack(packet)[5:]
        if np.hypot(*said) * 1.3 <= self.config.speed_mps:
            self.said.append((self.now + self.config.promise_ms, i, said))
        for j in range(len(self.robots)):
            # What the guard counts on: nobody in range goes unheard for as long as it remembers.
            due = (
                self.now - self.heard[j, i]
                > self.config.forget_ms - 2 * self.config.state_every * self.config.period_ms
            )
            if j != i and (due or self.chance.random() >= self.loss):
                self.push(self.now + self.chance.uniform(0, self.config.radio_ms), "hear", j, packet)
                self.heard[j, i] = self.now

    def hear(self, j, packet):
        self.robots[j].on_recv(int(self.now), packet)
