"""Fifty browser-like clients (websockets, a key each from the QR code) at ten commands a second."""

from __future__ import annotations

import asyncio
import json
import time
import urllib.request

import pytest

from conftest import a_gateway, eventually
from phalanx.io import Client

CLIENTS, RATE_HZ = 50, 10


def state_of(ready: dict) -> dict:
    address, token = ready["operator_url"].split("/#token=")
    request = urllib.request.Request(f"{address}/api/state", headers={"Authorization": f"Bearer {token}"})
    return json.load(urllib.request.urlopen(request))


def arrived(state: dict) -> int:
    return state["counters"]["commands"] + state["rejected"].get("late", 0)


async def drive(ready: dict, n: int, for_s: int) -> int:
    sent = 0
    async with Client(ready["qr_url"], timeout_s=30) as client:
        robots = await client.request(0, frames=True, timeout_s=30)
        address = robots[n % len(robots)]["address"]
        began = time.monotonic()
        for tick in range(RATE_HZ * for_s):
            await asyncio.sleep(max(0.0, began + tick / RATE_HZ - time.monotonic()))
            sent += await client.command(address, "move_raw", {"left_x": 0, "left_y": 40, "right_x": 0, "right_y": n})
        await asyncio.sleep(1)
        assert not client.rejected
    return sent


@pytest.mark.alone
@pytest.mark.slow
@pytest.mark.parametrize("for_s", [6, pytest.param(30, marks=pytest.mark.long)])
async def test_no_command_of_fifty_visitors_is_lost(for_s):
    with a_gateway("--robots", "20") as (up, ready):
        sent = sum(await asyncio.gather(*(drive(ready, n, for_s) for n in range(CLIENTS))))
        assert sent == CLIENTS * RATE_HZ * for_s
        await eventually(lambda: arrived(state_of(ready)) == sent, 20, 0.5)
        state = state_of(ready)
        # On a busy machine a command may lie unread for longer than a joystick's word is good for: counted, not obeyed.
        # How many is a matter of the machine.
        assert set(state["rejected"]) <= {"late"}
        assert state["counters"]["commands"]
        assert len(state["visitors"]) == CLIENTS
        await eventually(lambda: len(up.events("command")) == state["counters"]["commands"])
        ticks = state["counters"]["notifications"] / state["uptime_s"]
        assert ticks <= 2 * 10.5, (
            "one encryption a tick for sessions and one for mode qrkey, whatever the number of visitors"
        )
