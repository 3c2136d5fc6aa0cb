"""What is done to messages: those of another day, and more than a robot remembers."""

from __future__ import annotations

from .between import Between


class StaleMessage(Between):
    """The release of yesterday, sent today, when the goods are not released."""

    released = False

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        """And yesterday's with them, all the time."""
        return (*messages, *self.plan.yesterday.said) if self.lies else messages


class DrownMessage(Between):
    """So many messages that the robot has forgotten the true one when it needs it."""

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        """And a random one after them."""
        return (*messages, self.plan.chance.bytes(32)) if self.lies else messages
