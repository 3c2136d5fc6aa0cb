"""A robot in an adversary's hands: an honest robot inside, whose events and actions an attack changes.

An attack overrides events, or the steps that they are made of: `decide`, `put_out`, `act`, `send`, `next_packet` and
`make_request`. What it does not override is what the robot inside does. The trusted nodes only answer calls.
"""

from __future__ import annotations

from collections.abc import Callable

from phalanx.bti.audit import INPUT
from phalanx.bti.fleet import Fleet
from phalanx.bti.work import Work
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.controllers.python_controller import Act, Controller, OwnMistake, Send, kind_of
from phalanx.robot.robot import Robot


class Wrapper:
    """Robot `i` of a fleet, compromised. Arguments as for a `Robot`."""

    is_own = False  # its mistakes are the adversary's

    def __init__(
        self, fleet: Fleet, i: int, work: Work, make_controller: Callable[[int], Controller] | None = None
    ) -> None:
        self.robot = Robot(fleet, i, work, make_controller)
        self.robot.is_own = False
        self.f, self.i, self.w = fleet, i, work
        self.id, self.profile = self.robot.id, self.robot.profile

    @property
    def controller(self) -> Controller | None:
        """The controller in plain Python that the robot runs."""
        return self.robot.controller

    @property
    def make_controller(self) -> Callable[[int], Controller] | None:
        """What makes a robot's controller."""
        return self.robot.make_controller

    @property
    def raw(self) -> bytes:
        """What the next reading carries only a hash of."""
        return self.robot.raw

    @raw.setter
    def raw(self, raw: bytes) -> None:
        self.robot.raw = raw

    def bring_up(self) -> None:
        """As of a `Robot`."""
        self.robot.bring_up()

    # --- events ---

    def on_boot(self, now_ms: int) -> None:
        """The mission key has just been loaded."""
        self.robot.on_boot(now_ms)

    def on_reading(self, now_ms: int, reading: bytes) -> list[Action]:
        """The sensors were read."""
        n = self.robot.take(INPUT, now_ms, reading)
        return self.carry_out(now_ms, n) if n > 0 else []

    def carry_out(self, now_ms: int, entry_len: int) -> list[Action]:
        """Decide on the INPUT in `work.entry`, and put out what that gives."""
        asked = (self.checked("put_out", self.put_out(now_ms, output)) for output in self.decide(entry_len))
        return [action for each in asked for action in each]

    def checked(self, method: str, asked: object) -> list[Action]:
        """Return what a method returned if that is actions: an attack may be a researcher's own.

        Raises: OwnMistake: it is not.
        """
        if isinstance(asked, list) and all(isinstance(each, Action) for each in asked):
            return asked
        wrong = next(each for each in asked if not isinstance(each, Action)) if isinstance(asked, list) else asked
        raise OwnMistake(f"{method} returned {kind_of(wrong)}", "a list of actions, empty for nothing", self, method)

    def on_advice(self, advice: bytes) -> None:
        """A planner has advised."""
        self.robot.on_advice(advice)

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        """A packet has arrived."""
        return self.robot.on_packet(now_ms, packet)

    def on_round(self, now_ms: int, *, listened: bool) -> list[Action]:
        """T_audit has passed, or the robot has listened since."""
        if listened:
            return self.begin_round(now_ms)
        actions, waits = self.robot.listen(now_ms)
        return actions if waits else actions + self.begin_round(now_ms)

    def begin_round(self, now_ms: int) -> list[Action]:
        """Begin a round."""
        return self.robot.begin_round(now_ms) + self.next_packet(now_ms)

    def on_retry(self, now_ms: int) -> list[Action]:
        """The retry time has passed."""
        actions, is_missing = self.robot.seek(now_ms)
        return actions + self.next_packet(now_ms) if is_missing else actions

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        """The radio is done with the last fragment."""
        if not arrived:
            self.robot.not_arrived(now_ms)
        return self.next_packet(now_ms)

    # --- steps ---

    def decide(self, entry_len: int) -> list[Send | Act]:
        """Return the outputs for the INPUT in `work.entry`."""
        return self.robot.decide(entry_len)

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        """Put out one output."""
        if isinstance(output, Send):
            return self.send(now_ms, output.payload, EVERYBODY)
        return self.act(now_ms, output.payload)

    def act(self, now_ms: int, command: bytes) -> list[Action]:
        """Pass a command through the a-node."""
        return self.robot.act(now_ms, command)

    def send(self, now_ms: int, packet: bytes, to: int) -> list[Action]:
        """Pass a packet through the a-node."""
        return self.robot.send(now_ms, packet, to)

    def next_packet(self, now_ms: int) -> list[Action]:
        """Send the next fragment of an audit request, if one is due."""
        n = self.robot.next_fragment(now_ms)
        if n == 0 and self.make_request(now_ms):
            n = self.robot.next_fragment(now_ms)
        return self.robot.ask_with(now_ms, n)

    def make_request(self, now_ms: int) -> bool:
        """Make a request for an audit; return whether there is one."""
        return self.robot.make_request(now_ms)
