"""DotBots, the papers' own robots, behind PyDotBot's controller."""

from .swarm import DotbotSwarm
from .url import DotbotUrl, parse_dotbot_url

__all__ = ["DotbotSwarm", "DotbotUrl", "parse_dotbot_url"]
