"""Where a broker of ours listens, and who may do what there.

Visitors ask and command, and hear the swarm; nothing else. So nobody but the gateway speaks as the swarm, pin or not,
and nobody but the gateway hears a visitor. Epochs come and go: their topic is any.
"""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl
from .ports import LOOPBACK

# Below root and epoch, in MQTT's own words for patterns.
WRITE = ("request", "command/#")
READ = ("notify", "reply/+")


@dataclass(frozen=True, slots=True)
class Listeners:
    """Where a broker of ours listens."""

    visitors_port: int  # TCP on loopback, for visitors' programs on this machine
    gateway_port: int  # TCP on loopback, for the gateway alone
    ws_host: str  # address at which browsers reach it
    ws_port: int
    login: Login  # the gateway's
    root: str  # first part of every topic

    @property
    def gateway(self) -> BrokerUrl:
        """For the gateway: who is here may speak as the swarm."""
        return BrokerUrl("mqtt", LOOPBACK, self.gateway_port, login=self.login)

    def may_write(self, topic: str) -> bool:
        """Whether visitors may publish there."""
        sub = self._below_epoch(topic)
        return sub == ["request"] or sub[:1] == ["command"]

    def may_read(self, topic: str) -> bool:
        """Whether visitors are told what is published there."""
        sub = self._below_epoch(topic)
        return sub == ["notify"] or (len(sub) == 2 and sub[0] == "reply")

    def _below_epoch(self, topic: str) -> list[str]:
        return topic.removeprefix(f"{self.root}/").split("/")[1:] if topic.startswith(f"{self.root}/") else []
