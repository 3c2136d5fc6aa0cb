"""A thousand visitors and a thousand robots that move, ten updates a second: what they cost, and how soon one is out.

    python benchmarks/bench_thousand.py [--visitors 1000] [--robots 1000] [--seconds 10] [--joins-per-s 35]

The gateway is `phalanx up` as people run it. Visitors are this process: they join and send a route as pages do, and
read of updates the head alone, as their work is not counted. Processor time is that of each process, not of the clock.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from front_attacks import Client, Session, connected, frame, now_ms
from processes import children, cpu_s
from rows import Row, print_table

from phalanx.cli.gateway_of import ask_gateway
from phalanx.net.seats import raise_file_limit
from phalanx.wire.sessions import UPDATE_HEAD

MOST_GATEWAY, MOST_FRONT, MOST_JOIN_S, MOST_REMOVAL_S = 0.4, 0.6, 2.0, 1.0
PATIENCE_S = 20.0
UPDATE_TAG = UPDATE_HEAD.encode(epoch=0, counter=0)[0]


class Reader(Session):
    """A visitor that notes what updates come: how many bytes, in which epoch, and when that began."""

    def __init__(self, code: str) -> None:
        super().__init__(code)
        self.newest = b""
        self.updates, self.longest, self.epoch, self.since_s = 0, 0, 0, 0.0

    def receive(self, message: bytes) -> bytes:
        if message[0] != UPDATE_TAG:
            return super().receive(message)
        epoch = UPDATE_HEAD.decode(message[: UPDATE_HEAD.size])["epoch"]
        if epoch != self.epoch:
            self.epoch, self.since_s = epoch, time.monotonic()
        self.updates += 1
        self.longest, self.newest = max(self.longest, len(message)), message
        return b""

    def follow(self, robot: str) -> bytes:
        """Return a route, which is based on the newest update."""
        if self.newest:
            super().receive(self.newest)
        points = [{"x": 200 + 1600 * (k % 2), "y": 100 + 25 * k, "z": 0} for k in range(64)]
        payload = json.dumps({"threshold": 60, "waypoints": points}).encode()
        return frame(self.client.command(robot, "waypoints", payload, now_ms()).data)


async def join(port: int, code: str, n: int) -> tuple[Client, float]:
    began_s = time.monotonic()
    client = await connected(port, f"127.0.{2 + n // 250}.{1 + n % 250}", lambda: Client(Reader(code)))
    await asyncio.wait_for(client.ready, PATIENCE_S)
    return client, time.monotonic() - began_s


async def measure(ready: dict, pid: int, state: Path, chosen: argparse.Namespace) -> list[Row]:
    port = int(ready["page_url"].rstrip("/").rpartition(":")[2])
    said = await asyncio.to_thread(ask_gateway, state, "link/state", {})
    joining = []
    for n in range(chosen.visitors):
        joining.append(asyncio.create_task(join(port, ready["qr_url"], n)))
        await asyncio.sleep(1 / chosen.joins_per_s)
    joined = [each for each in await asyncio.gather(*joining, return_exceptions=True) if isinstance(each, tuple)]
    clients, joins_s = [client for client, _ in joined], sorted(took_s for _, took_s in joined)
    for client, robot in zip(clients, said["robots"], strict=False):
        client.transport.write(client.session.follow(robot["address"]))
        await asyncio.sleep(0.005)
    processes = {"gateway": [pid], "front end": children(pid)}
    before = {each: cpu_s(each) for pids in processes.values() for each in pids}
    updates, began_s = sum(client.session.updates for client in clients), time.monotonic()
    await asyncio.sleep(chosen.seconds)
    took_s = time.monotonic() - began_s
    updates = sum(client.session.updates for client in clients) - updates
    cores = {name: sum(cpu_s(each) - before[each] for each in pids) / took_s for name, pids in processes.items()}
    visitors = (await asyncio.to_thread(ask_gateway, state, "link/state", {}))["session"]["visitors"]
    epoch, asked_s = max(client.session.epoch for client in clients), time.monotonic()
    await asyncio.to_thread(ask_gateway, state, "link/remove", {"visitor": visitors[0]["visitor"]})
    # This process may lag behind the gateway: so that a lag is a number, and no failure.
    while time.monotonic() - asked_s < PATIENCE_S:
        await asyncio.sleep(0.1)
        here = [client for client in clients if not client.is_over]
        late = [client for client in here if client.session.epoch == epoch]
        if not late and len(here) < len(clients):
            break
    removal_s = max(client.session.since_s for client in here) - asked_s if not late else float("inf")
    note = f"{updates / took_s / len(clients):.1f} updates/s to each of {len(clients)}"
    longest = max(client.session.longest for client in clients)
    return [
        Row(section=0, what="gateway", measured=cores["gateway"], unit="cores", limit=MOST_GATEWAY, note=note),
        Row(section=0, what="front end", measured=cores["front end"], unit="cores", limit=MOST_FRONT),
        Row(
            section=0,
            what="join, p99",
            measured=joins_s[len(joins_s) * 99 // 100],
            unit="s",
            limit=MOST_JOIN_S,
            note=f"p50 {joins_s[len(joins_s) // 2]:.2f} s; {len(joined)} of {chosen.visitors} came in",
        ),
        Row(
            section=0,
            what="removal: all others read the next epoch",
            measured=removal_s,
            unit="s",
            limit=MOST_REMOVAL_S,
            note=f"{len(clients) - len(here)} of {len(clients)} were closed",
        ),
        Row(section=0, what="longest update", measured=longest / 1024, unit="KiB", note="with head and signature"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--visitors", type=int, default=1000)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--joins-per-s", type=float, default=35.0)
    chosen = parser.parse_args()
    raise_file_limit(8192)
    with tempfile.TemporaryDirectory() as folder:
        state = Path(folder, "state")
        words = ["--events", "--port", "0", "--defence", "none", "--robots", str(chosen.robots), "--state", str(state)]
        up = [sys.executable, "-m", "phalanx", "up", *words]
        with subprocess.Popen(up, stdout=subprocess.PIPE, text=True, env=os.environ) as gateway:
            try:
                ready = json.loads(gateway.stdout.readline())
                print_table(asyncio.run(measure(ready, gateway.pid, state, chosen)))
            finally:
                gateway.kill()


if __name__ == "__main__":
    main()
