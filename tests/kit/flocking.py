"""Packets of flocking robots, and a controller of the flock."""

from __future__ import annotations

import struct

from phalanx.config.flock import Disc, FlockConfig
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.flock_law import flock_params
from phalanx.robot.controllers.python_controller import Act

PERIOD_MS = 250
CONFIG = FlockConfig(n_max=5, c1_beta=1.0, c2_beta=0.5, discs=(Disc(x_m=8, y_m=9, radius_m=3),))


def reading(rob, x, y, vx=0.0, vy=0.0, t=0):
    return struct.pack("<BHQ4f", 0x02, rob, t, x, y, vx, vy)


def state(rob, x, y, vx=0.0, vy=0.0, t=0):
    return struct.pack("<BHQ4f", 0x01, rob, t, x, y, vx, vy)


def acceleration(outputs):
    (payload,) = (output.payload for output in outputs if isinstance(output, Act))
    return struct.unpack_from("<2f", payload, 11)


def robot(rob=1, config=CONFIG):
    return compiled(dispatch.NUMBERS["flock"], flock_params(config))(rob)
