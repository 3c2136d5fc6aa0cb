"""Where robots go: a double integrator each, moved only when somebody asks where it is; and who touched what.

Nothing stops a robot but its own brakes: the law of flocking knows no collisions, so contacts only count.
"""

from __future__ import annotations

import math

from phalanx.arrays import F64x1, F64x2, I64x1
from phalanx.kernel import kernel
from phalanx.sim.radio.reach import Reach, walled


@kernel
def advance(pos: F64x2, vel: F64x2, acc: F64x2, at_us: I64x1, i: int, now_us: int) -> None:
    """Robot i is where its last command has brought it by now: exact, as the acceleration is constant in between.

    `pos`, `vel` and `acc`, (N, 2), m, m/s and m/s², are those of at_us[i], (N,), which is `now_us` afterwards.
    Source: RoboRebound §4 (double integrator).
    """
    dt = (now_us - at_us[i]) * 1e-6
    for axis in range(2):
        pos[i, axis] += dt * (vel[i, axis] + 0.5 * dt * acc[i, axis])
        vel[i, axis] += dt * acc[i, axis]
    at_us[i] = now_us


@kernel
def command(acc: F64x2, i: int, ax: float, ay: float, most_mps2: float) -> None:
    """Robot i accelerates so from now on, each axis clipped to what it can; what is not a number is no acceleration.

    The robot must have been advanced to now. `acc`: (N, 2), m/s².
    Source: RoboRebound §4.
    """
    acc[i, 0], acc[i, 1] = _clip(ax, most_mps2), _clip(ay, most_mps2)


@kernel
def robot_contacts(pos: F64x2, last: F64x2, reach: Reach, contact_m: float) -> int:
    """How many pairs of robots came closer than `contact_m` since the last look, counted once until they part again.

    Between two looks robots are taken to go straight, so none passes through another unseen. `pos`, (N, 2), metres, is
    what `reach` was rebuilt for, with a range of at least `contact_m`; `last` is `pos` at the last look, NaN at the
    first. Distances are between centres.
    """
    count = 0
    limit = contact_m * contact_m
    # Two that are farther apart than both can have gone since, and that much more, have not met.
    far = contact_m + 2.0 * _longest_step(pos, last) + 0.01
    beyond = far * far
    for i in range(len(pos)):
        if reach.least_m[i] > far + reach.skin_m:  # since that was noted, two have come nearer by the skin at most
            continue
        for at in range(reach.near[i], reach.near[i + 1]):
            k = int(reach.maybe[at])
            x, y = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
            if k < i or x * x + y * y > beyond or walled(reach, i, k):
                continue
            was_x, was_y = last[k, 0] - last[i, 0], last[k, 1] - last[i, 1]
            if was_x * was_x + was_y * was_y < limit:  # in contact already
                continue
            if _closest(was_x, was_y, x, y) < limit:
                count += 1
    return count


@kernel
def _longest_step(pos: F64x2, last: F64x2) -> float:
    """How far somebody has gone at most since the last look, metres; who was not there then has gone nowhere."""
    longest = 0.0
    for i in range(len(pos)):
        x, y = pos[i, 0] - last[i, 0], pos[i, 1] - last[i, 1]
        if x * x + y * y > longest:  # noqa: PLR1730 - `max` of what is not a number is another, compiled
            longest = x * x + y * y
    return math.sqrt(longest)


@kernel
def obstacle_contacts(pos: F64x2, last: F64x2, discs: F64x2, boxes: F64x2, contact_m: float) -> int:
    """How many times a robot has come to touch an obstacle since the last look, counted once until they part again.

    An obstacle is touched when its edge is less than half of `contact_m` from a robot's centre. Seen at the two looks
    only: at 10 m/s a robot goes half a metre in the 50 ms between them, and obstacles are larger. `pos` and `last` are
    as above; `discs`, (D, 3): centre x, y, radius; `boxes`, (B, 4): least x, least y, greatest x, greatest y, metres.
    """
    count = 0
    radius = 0.5 * contact_m
    for i in range(len(pos)):
        for n in range(len(discs)):
            if _in_disc(pos[i], discs[n], radius) and not _in_disc(last[i], discs[n], radius):
                count += 1
        for n in range(len(boxes)):
            if _in_box(pos[i], boxes[n], radius) and not _in_box(last[i], boxes[n], radius):
                count += 1
    return count


@kernel
def _clip(asked: float, most: float) -> float:
    if asked >= most:
        return most
    if asked <= -most:
        return -most
    return asked if asked == asked else 0.0  # noqa: PLR0124 (the one number that is not itself)


@kernel
def _closest(from_x: float, from_y: float, to_x: float, to_y: float) -> float:
    """Least square distance from the origin to the stretch between two points; to its end if it has no beginning."""
    if math.isnan(from_x + from_y):
        return to_x * to_x + to_y * to_y
    step_x, step_y = to_x - from_x, to_y - from_y
    length = step_x * step_x + step_y * step_y
    share = -(from_x * step_x + from_y * step_y) / length if length > 0 else 0.0
    share = min(1.0, max(0.0, share))
    x, y = from_x + share * step_x, from_y + share * step_y
    return x * x + y * y


@kernel
def _in_disc(at: F64x1, disc: F64x1, radius: float) -> bool:
    x, y, reach = at[0] - disc[0], at[1] - disc[1], disc[2] + radius
    return x * x + y * y < reach * reach  # type: ignore[no-any-return]


@kernel
def _in_box(at: F64x1, box: F64x1, radius: float) -> bool:
    if not (math.isfinite(at[0]) and math.isfinite(at[1])):
        return False
    x = max(box[0] - at[0], 0.0, at[0] - box[2])
    y = max(box[1] - at[1], 0.0, at[1] - box[3])
    return x * x + y * y < radius * radius  # type: ignore[no-any-return]
