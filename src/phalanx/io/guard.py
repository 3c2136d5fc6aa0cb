"""The guard: a process that visitors of a broker of ours come to, and that passes on to it what visitors send.

mosquitto keeps what it is given: sessions that sleep, subscriptions, news for readers that stall, connections that say
nothing. Here each visitor may have a little of everything, and all of them together a fixed amount. What they want of
us they get in turns (`turns.py`): head by head who has proved the pin, place by place the others. A turn is so short
that this loop is never late. Whoever is not to be contented is hung up on. The control loop lives in another process,
and is held up by nothing of it.

Started by `guarding.py`: `python -m phalanx.io.guard PARENT SOCKET HEARD DOOR…`: whose child it is, the paths of the
broker's socket and of what the gateway tells (`heard.py`), and the numbers of sockets that listen: for whoever watches
us, for programs, and for browsers.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
import time
from pathlib import Path

from .children import end_with
from .heard import Heard
from .house import AT_ONCE_S, House
from .seats import allow_files, place_of
from .visitor import Visitor

VISITORS = 1000
FILES_EACH, FILES_APART = 2, 64
MANY_FILES = 4096
OUT_OF_FILES_S = 1.0


class Door:
    """One at which visitors come."""

    def __init__(self, house: House, listening: socket.socket, *, browser: bool) -> None:
        self._house, self._listening, self._browser = house, listening, browser
        listening.setblocking(False)

    def open(self) -> None:
        """Whoever comes is let in."""
        asyncio.get_running_loop().add_reader(self._listening, self._come)

    def _come(self) -> None:
        until_s = time.monotonic() + AT_ONCE_S
        while time.monotonic() < until_s:
            try:
                connection, address = self._listening.accept()
            except (BlockingIOError, ConnectionError):
                return
            except OSError:  # no file is left: somebody goes soon
                loop = asyncio.get_running_loop()
                loop.remove_reader(self._listening)
                loop.call_later(OUT_OF_FILES_S, self.open)
                return
            connection.setblocking(False)
            place = place_of(address[0]) if address else ""
            Visitor(self._house, connection, place, browser=self._browser)


async def guard(broker: str, heard: Heard, *doors: socket.socket) -> None:
    """Let visitors in until SIGTERM."""
    house = House(broker, min(VISITORS, (allow_files(MANY_FILES) - FILES_APART) // FILES_EACH), heard)
    over = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, over.set)
    for listening in doors:
        Door(house, listening, browser=listening is doors[-1]).open()
    watching = asyncio.create_task(house.watch())
    await over.wait()
    watching.cancel()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends us when the last word is out
    parent, broker, heard, *doors = sys.argv[1:]
    end_with(int(parent))
    asyncio.run(guard(broker, Heard(Path(heard)), *(socket.socket(fileno=int(number)) for number in doors)))
