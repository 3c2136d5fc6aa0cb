"""The front end of the direct transport: a process of its own for the visitors' page and their websockets."""

from .gateway_end import Closed, Event, Front, Opened, Received

__all__ = ["Closed", "Event", "Front", "Opened", "Received"]
