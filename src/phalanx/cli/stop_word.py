"""The emergency stop of a terminal: lines on stdin, read in a thread of their own, whatever the event loop does."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable

from .terminal import talk

STOP, GO = ("", "stop"), "go"
IN_THE_BACKGROUND_S = 1.0
LONGEST = 4096


def heed_stop_words(hold: Callable[[bool], None]) -> None:
    """Enter or `stop` on stdin holds all robots, `go` lets them go again, until stdin ends."""
    # A shell's background job may not read: it is told so by an error instead of being stopped itself.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    threading.Thread(target=_listen, args=(hold,), name="stop word", daemon=True).start()


def _listen(hold: Callable[[bool], None]) -> None:
    waiting = b""
    while True:
        try:
            # By hand: a thread that sits in a buffer's lock does not let the interpreter end.
            said = os.read(sys.stdin.fileno(), LONGEST)
        except OSError:
            time.sleep(IN_THE_BACKGROUND_S)
            continue
        if not said:
            return
        *lines, waiting = (waiting + said).split(b"\n")
        waiting = waiting[:LONGEST]
        for line in lines:
            _obey(line.decode(errors="replace").strip().lower(), hold)


def _obey(word: str, hold: Callable[[bool], None]) -> None:
    if word in STOP:
        hold(True)
        talk("all robots stand still; type go and Enter to let them go")
    elif word == GO:
        hold(False)
        talk("robots may move again")
    else:
        talk("Enter, or stop and Enter, stops all robots; go and Enter lets them go again")
