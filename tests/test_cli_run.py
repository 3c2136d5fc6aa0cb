"""How a coroutine that the command line runs is ended."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal

import pytest

from phalanx.cli import run


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_who_swallows_a_cancellation_is_told_again(number, monkeypatch):
    monkeypatch.setattr(run, "AGAIN_S", 0.05)
    before = signal.signal(number, signal.SIG_DFL)  # under nohup SIGHUP is ignored
    ended = []

    async def deaf() -> None:
        try:
            with contextlib.suppress(asyncio.CancelledError):
                os.kill(os.getpid(), number)
                await asyncio.sleep(30)
            await asyncio.sleep(30)
        finally:
            ended.append(True)

    try:
        assert run.run(deaf()) is False
    finally:
        signal.signal(number, before)
    assert ended == [True]


def test_who_comes_to_the_end_was_not_stopped():
    assert run.run(asyncio.sleep(0))
