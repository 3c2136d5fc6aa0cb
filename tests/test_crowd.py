"""A crowd at the visitors' page: robots are driven as before."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import time

import pytest

from conftest import eventually
from phalanx.gateway import Gateway, VisitorPages
from phalanx.gateway.site import PAGES, beside
from phalanx.io import Client, Server
from phalanx.sim import Dotbots

CROWD = """
import resource, socket, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (2048, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
port, path = int(sys.argv[1]), sys.argv[2]
def come():
    one = socket.socket()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    one.settimeout(20)
    one.connect(("127.0.0.1", port))
    one.send(b"GET %s HTTP/1.1\\r\\nHost: x\\r\\n\\r\\n" % path.encode())
    return one
crowd = [come() for _ in range(1000)]
print("all there", flush=True)
for one in crowd[500:]:  # the others never read
    while len(one.recv(65536)) == 65536:
        pass
time.sleep(60)
"""


class Turns:
    """The longest turn of this event loop, in seconds of processor time: what others do with the machine is not in it."""

    def __init__(self) -> None:
        self.longest_s, self._before_s = 0.0, time.thread_time()
        asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        now_s = time.thread_time()
        self.longest_s, self._before_s = max(self.longest_s, now_s - self._before_s), now_s
        asyncio.get_running_loop().call_later(0.001, self._turn)


@pytest.mark.alone
async def test_a_thousand_at_the_page_of_whom_half_do_not_read_hold_up_no_joystick(broker):
    swarm, driven = Dotbots(12, 1, time.time), []
    swarm.drive = lambda _, left_pct, __: driven.append(left_pct)
    script = max((PAGES / "visitor" / "assets").glob("*.js"), key=lambda path: path.stat().st_size)
    async with (
        Server(broker.gateway, broker_for_visitors=broker.websocket) as server,
        beside(VisitorPages("127.0.0.1", 0)) as pages,
    ):
        gateway = asyncio.create_task(Gateway(swarm, server).run())
        await server.wait_connected(10)
        async with Client(server.qr()) as visitor:
            address = swarm.robots()[0].address
            words = (sys.executable, "-c", CROWD, str(pages.port), f"/assets/{script.name}")
            crowd = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
            came = asyncio.create_task(crowd.stdout.readline())
            turns, sent = Turns(), 0
            try:
                while not came.done() or sent < 60:
                    sent += 1
                    await visitor.command(address, "move_raw", {"left_y": sent % 100 + 1, "right_y": 0})
                    await asyncio.sleep(0.05)
                assert came.result() == b"all there\n"
                await eventually(lambda: len(driven) + server.rejected["late"] >= sent)
                assert turns.longest_s < 0.05
                assert server.rejected["late"] < sent / 10
            finally:
                with contextlib.suppress(ProcessLookupError):
                    crowd.kill()
                await crowd.communicate()
        gateway.cancel()
