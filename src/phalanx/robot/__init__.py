"""What a robot is to those who command it, and the controllers it runs."""

from .swarm import Led, Point, Robot, Swarm

__all__ = ["Led", "Point", "Robot", "Swarm"]
