"""Front end of the gateway: a separate process that serves the visitors' page and their websockets."""

from .gateway_end import Closed, Event, Front, Opened, Received

__all__ = ["Closed", "Event", "Front", "Opened", "Received"]
