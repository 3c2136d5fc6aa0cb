"""DotBots, the papers' own robots, behind PyDotBot's controller."""

from .line import DotbotUrl, parse_dotbot_url
from .swarm import DotbotSwarm

__all__ = ["DotbotSwarm", "DotbotUrl", "parse_dotbot_url"]
