"""What is done to messages: those of another day, and more than a robot remembers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from phalanx.robot.attacks.attack import Defence, Verdict

from .attack import MissionAttack
from .harm import WRONG


class StaleMessage(MissionAttack):
    """The release of yesterday, sent today, when the goods are not released."""

    name = "stale-message"
    against = "messages"
    does = "sends the controller's release of yesterday, which the robot waits for and nobody gave today"
    stopped_by = "a controller's message is random and made anew for each mission: yesterday's opens nothing today"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "stopped", "bound": "stopped"}
    harm = WRONG
    released = False

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        """And yesterday's with them, all the time."""
        return (*messages, *self.plan.yesterday.said) if self.lies else messages


class DrownMessage(MissionAttack):
    """So many messages that the robot has forgotten the true one when it needs it."""

    name = "drown-message"
    against = "messages"
    does = "sends the robot random messages all the time, until it has forgotten the true one"
    stopped_by = "nothing is done that should not be; what the robot waits for is lost, until it is sent again"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "stopped", "bound": "stopped"}
    harm = WRONG

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        """And a random one after them."""
        return (*messages, self.plan.chance.bytes(32)) if self.lies else messages
