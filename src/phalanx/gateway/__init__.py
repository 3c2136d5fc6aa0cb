"""The running system: a swarm behind the link, and the pages that show it."""

from .gateway import Gateway
from .serve_pages import OperatorPages, pages_are_built
from .up import UpOptions, up

__all__ = ["Gateway", "OperatorPages", "UpOptions", "pages_are_built", "up"]
