"""A few robots of a protocol in a world of one clock: bodies, packets that may be lost, and no audits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from phalanx.robot.controllers.protocol import Task, find_protocol
from phalanx.robot.controllers.python_controller import Act, Controller
from phalanx.scenarios.file import find_scenario
from phalanx.wire.table import ACCELERATION, KIND_SENSOR, SENSOR

CONTROL_S = 0.25


def task_of(name: str, robots: int, seed: int = 0) -> Task:
    """Of the scenario that comes with the protocol, with so many robots."""
    return replace(find_scenario(name), robots=robots, seed=seed, bti=replace(find_scenario(name).bti, f_max=1)).task


class ProtocolWorld:
    """Robots 1.. of a task, all read at the same moments; what one says, the others hear at once, or never.

    Attributes:
        relayed: each call goes to a new controller, which goes on from the last one's encoding.
        said: all that was put out, in its order.
    """

    def __init__(self, name: str, task: Task, lost: Callable[[int, int, int], bool] = lambda *_: False) -> None:
        protocol = find_protocol(name)
        assert protocol
        self.make = protocol.maker(task)
        self.ids = range(1, len(task.starts_m) + 1)
        self.robots: dict[int, Controller] = {rob_id: self.make(rob_id) for rob_id in self.ids}
        self.stage, self.lost, self.relayed = protocol.stage(task), lost, False
        self.place_m = {rob_id: list(start) for rob_id, start in zip(self.ids, task.starts_m)}
        self.pace_mps = {rob_id: [0.0, 0.0] for rob_id in self.ids}
        self.said: list[bytes] = []

    def robot(self, rob_id: int) -> Controller:
        """It, or another in its state."""
        if self.relayed:
            encoding, self.robots[rob_id] = self.robots[rob_id].encode(), self.make(rob_id)
            self.robots[rob_id].decode(encoding)
        return self.robots[rob_id]

    def steps(self, seconds: float) -> Iterator[int]:
        """Goes on, and stops after each control step."""
        for step in range(round(seconds / CONTROL_S)):
            t_ms = 1000 + round(1000 * CONTROL_S * step)
            heard = [self._act(rob_id, step, t_ms) for rob_id in self.ids]
            for rob_id, packets in zip(self.ids, heard):
                for other in self.ids:
                    if other != rob_id and packets and not self.lost(rob_id, other, step):
                        for packet in packets:
                            self.robot(other).on_recv(t_ms + 1, packet)
            yield step

    def live(self, seconds: float) -> None:
        """Goes on."""
        for _ in self.steps(seconds):
            pass

    def _act(self, rob_id: int, step: int, t_ms: int) -> list[bytes]:
        place, pace = self.place_m[rob_id], self.pace_mps[rob_id]
        seen = self.stage.look(rob_id, step * CONTROL_S, tuple(place), lies=False)
        told = self.robot(rob_id).on_input(
            step, t_ms, SENSOR.form.pack(KIND_SENSOR, rob_id, t_ms, *place, *pace) + seen
        )
        self.said += [each.payload for each in told]
        for act in (each.payload for each in told if isinstance(each, Act)):
            for axis, push in enumerate(ACCELERATION.form.unpack(act)[3:]):
                place[axis] += CONTROL_S * (pace[axis] + CONTROL_S * push / 2)
                pace[axis] += CONTROL_S * push
        return [each.payload for each in told if not isinstance(each, Act)]
