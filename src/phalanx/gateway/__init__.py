"""The running system: a swarm behind the link, and the pages that show it."""

from .gateway import Gateway
from .serve_pages import OperatorPages, VisitorPages, pages_are_built

__all__ = ["Gateway", "OperatorPages", "VisitorPages", "pages_are_built"]
