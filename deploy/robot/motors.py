"""A stand-in for the board that has a robot's motors: reads lines `LEFT RIGHT` and writes the newest to a file.

Like a real motor driver it has a watchdog: wheels stand when no line has come for WATCHDOG_S. It must be longer than
t_control_ms + 2 delta_ms of the mission. Nothing else stops motors when the robot's process is killed outright.
"""

import os
import select
import sys
from pathlib import Path

WATCHDOG_S = 0.5


def main(path: str) -> None:
    """Obey lines from stdin until it ends."""
    with Path(path).open("w", encoding="ascii", buffering=1) as wheels:
        while True:
            came = select.select([0], [], [], WATCHDOG_S)[0]
            lines = os.read(0, 4096).split(b"\n") if came else []
            wheels.seek(0)
            wheels.write(f"{lines[-2].decode() if len(lines) > 1 else '0 0':<10}\n")
            if came and lines == [b""]:  # the robot's process has gone; a serial line would only fall silent
                return


if __name__ == "__main__":
    main(sys.argv[1])
