"""Attacks on the front end: what honest visitors notice of them by the gateway's own clock, and what they cost.

    python benchmarks/bench_front.py [--seconds 8] [--csv FILE]

A gateway with twenty visitors of twenty commands a second each; one more visitor joins every second, and an operator
stops all robots twice a second. Attackers, in a process of their own that has at most half a core, come from 25
addresses, or from one.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import csv
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from front_attacks import Client, Session, connected, frame, now_ms
from processes import children, cpu_s, in_line_s, rss_mb

from phalanx.config.front import FrontConfig
from phalanx.config.session import SessionConfig
from phalanx.errors import UsageError
from phalanx.link.session import Invitation, Kind, MemoryStore, Now, Role, Secret, SessionServer, Ticket
from phalanx.link.session.events import Close, Commanded, Joined, Publish, Requested, Send
from phalanx.link.session.secret import INVITATION_BYTES
from phalanx.net.children import end_with_parent
from phalanx.net.front import Closed, Front, Opened, Received

VISITORS, PER_S, TICK_S = 20, 20, 0.1
STOP_EVERY_S = 0.5
STATE = bytes(1900)
CORE_SHARE = 0.5
PHONES, FILES = 50, 4
HERE = Path(__file__)
ATTACKS = HERE.with_name("front_attacks.py")
SPREAD = ",".join(f"127.0.2.{n}" for n in range(1, 26))
PHASES = (
    ("nobody", "", ""),
    ("1000 half-open connections", "half-open", SPREAD),
    ("500 slow readers", "slow readers", SPREAD),
    ("20 floods of garbage", "garbage", SPREAD),
    ("20 visitors that flood", "insiders' floods", SPREAD),
    ("20 that come and go", "come and go", SPREAD),
    ("20 that ask for pages", "pages", SPREAD),
    ("500 joins at once from one address", "joins", "127.0.0.9"),
    ("all of these", "half-open,slow readers,garbage,insiders' floods,come and go,pages,joins", SPREAD),
)
WITH_PHONES = ("nobody", "500 joins at once from one address", "all of these")


class Gaps:
    """The longest time between two commands of a visitor, and by how much a tick was late."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self.last: dict[object, float] = {}
        self.gaps: list[float] = []
        self.stops: list[float] = []
        self.late_s = 0.0
        self.joined = 0

    def command(self, who: object) -> None:
        now_s = time.monotonic()
        if who in self.last:
            self.gaps.append(now_s - self.last[who])
        self.last[who] = now_s

    def end(self) -> dict[str, float]:
        now_s = time.monotonic()
        gaps = sorted([*self.gaps, *(now_s - each for each in self.last.values())])
        found = {
            "visitors": len(self.last),
            "commands": len(self.gaps),
            "gap_s": gaps[-1] if gaps else 0.0,
            "p99_s": gaps[int(0.99 * (len(gaps) - 1))] if gaps else 0.0,
            "stops": len(self.stops),
            "stop_s": max(self.stops, default=0.0),
            "late_s": self.late_s,
            "joined": self.joined,
        }
        self.begin()
        return found

    async def ticks(self, tick) -> None:
        due_s = time.monotonic()
        while True:
            due_s += TICK_S
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            self.late_s = max(self.late_s, time.monotonic() - due_s)
            tick()


async def phases(gaps: Gaps, ready: dict) -> None:
    """Tell the benchmark, whenever it asks, what happened since."""
    print(json.dumps(ready), flush=True)
    loop = asyncio.get_running_loop()
    while await loop.run_in_executor(None, sys.stdin.readline):
        print(json.dumps(gaps.end()), flush=True)


class Gateway:
    """A session server over the front end."""

    def __init__(self, front: Front) -> None:
        self.front, self.gaps = front, Gaps()
        static = X25519PrivateKey.generate()
        signer, store = Ed25519PrivateKey.generate(), MemoryStore()
        self.server = SessionServer(SessionConfig(), static, signer, store, os.urandom, now())
        self.server.assignment.set_robots([f"R{n}" for n in range(VISITORS)] + ["NOBODY"], now_ms())
        key = static.public_key().public_bytes_raw()
        self.code = Invitation(key, self.server.door.code).fragment()
        secret = Secret(Kind.TICKET, os.urandom(INVITATION_BYTES))
        self.server.door.add_ticket(Ticket(secret, Role.OPERATE, 1, now().unix_s + 3600), now().unix_s)
        self.ticket = Invitation(key, secret).fragment()

    def carry(self, events) -> None:
        for event in events:
            match event:
                case Send(connection, data):
                    self.front.send(connection, data)
                case Publish(connections, data):
                    self.front.publish(connections, data)
                case Close(connection, reason):
                    self.front.close(connection, reason)
                case Commanded(visitor, robot):
                    self.carry(self.server.accept(event, now()))
                    if robot != "NOBODY":
                        self.gaps.command(visitor)
                case Requested(visitor, number, "stop", payload):
                    self.gaps.stops.append(time.monotonic() - float(payload))  # one clock for all processes
                    self.carry(self.server.reply(visitor, number, b"{}"))
                case Joined():
                    self.gaps.joined += 1

    async def listen(self) -> None:
        admitted: set[int] = set()
        async for event in self.front.events():
            match event:
                case Opened(connection, address):
                    self.carry(self.server.opened(connection, address, now()))
                case Received(connection, data):
                    self.carry(self.server.receive(connection, data, now()))
                    one = None if connection in admitted else self.server.connections.find(connection)
                    if one and one.visitor:
                        admitted.add(connection)
                        self.front.admitted(connection)
                case Closed(connection):
                    admitted.discard(connection)
                    self.carry(self.server.closed(connection, now()))

    def tick(self) -> None:
        self.carry(self.server.tick(now()))
        self.carry([self.server.publish(STATE, now())])


async def gateway(pages: Path) -> None:
    async with Front(pages, "default-src 'self'", "127.0.0.1", 0, FrontConfig()) as front:
        serving = Gateway(front)
        tasks = [asyncio.create_task(serving.listen()), asyncio.create_task(serving.gaps.ticks(serving.tick))]
        await phases(
            serving.gaps, {"port": front.port, "code": serving.code, "ticket": serving.ticket, "pid": os.getpid()}
        )
        for task in tasks:
            task.cancel()


def now() -> Now:
    return Now(now_ms(), int(time.time()))


class Visitors:
    """Twenty who drive, one more each second, and an operator."""

    def __init__(self, port: int, code: str, ticket: str) -> None:
        self.port, self.code, self.ticket = port, code, ticket
        self.took_s: list[float] = []
        self.failed = 0
        self.late_s = 0.0  # with a command, for want of a processor here

    async def run(self) -> None:
        tasks = [asyncio.create_task(self.drive(n)) for n in range(VISITORS)]
        tasks += [asyncio.create_task(self.keep_coming()), asyncio.create_task(self.operate())]
        loop = asyncio.get_running_loop()
        while await loop.run_in_executor(None, sys.stdin.readline):
            found = {"join_s": max(self.took_s, default=0.0), "joins": len(self.took_s), "join_failed": self.failed}
            found["sent_late_s"] = self.late_s
            self.late_s = 0.0
            print(json.dumps(found), flush=True)
            self.took_s.clear()
            self.failed = 0
        for task in tasks:
            task.cancel()

    async def drive(self, n: int) -> None:
        while True:
            with contextlib.suppress(OSError, TimeoutError, asyncio.CancelledError):
                client = await connected(self.port, f"127.0.1.{1 + n}", lambda: Client(Session(self.code)))
                await asyncio.wait_for(client.ready, 20)
                due_s = time.monotonic()
                while not client.is_over:
                    with contextlib.suppress(UsageError):
                        client.transport.write(frame(client.session.command(f"R{n}").data))
                    due_s += 1 / PER_S
                    await asyncio.sleep(max(0.0, due_s - time.monotonic()))
                    self.late_s = max(self.late_s, time.monotonic() - due_s)
            if asyncio.current_task().cancelling():
                return
            await asyncio.sleep(0.1)

    async def operate(self) -> None:
        client = await connected(self.port, "127.0.1.200", lambda: Client(Session(self.ticket)))
        await client.ready
        while not client.is_over:
            client.transport.write(frame(client.session.stop_all()))
            await asyncio.sleep(STOP_EVERY_S)

    async def keep_coming(self) -> None:
        coming: set[asyncio.Task[None]] = set()
        for n in itertools.count():
            coming.add(task := asyncio.create_task(self.come(n)))
            task.add_done_callback(coming.discard)
            await asyncio.sleep(1)

    async def come(self, n: int) -> None:
        began_s = time.monotonic()
        try:
            client = await connected(self.port, f"127.0.3.{1 + n % 250}", lambda: Client(Session(self.code)))
            await asyncio.wait_for(client.ready, 10)
            self.took_s.append(time.monotonic() - began_s)
            client.transport.abort()
        except (OSError, TimeoutError, asyncio.CancelledError):
            self.failed += 1


async def phones(port: int, code: str) -> None:
    """Fifty phones behind one router: each loads the page and its files, and joins, all at once."""
    began_s = time.monotonic()

    async def one() -> float:
        for _ in range(20):
            with contextlib.suppress(OSError, TimeoutError, asyncio.CancelledError):
                await asyncio.gather(*(page() for _ in range(FILES)))
                client = await connected(port, "127.0.0.50", lambda: Client(Session(code)))
                await asyncio.wait_for(client.ready, 5)
                return time.monotonic() - began_s
            await asyncio.sleep(0.5)
        return 0.0

    async def page() -> None:
        async with asyncio.timeout(10):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=("127.0.0.50", 0))
            with contextlib.closing(writer):
                writer.write(b"GET / HTTP/1.1\r\nHost: us\r\nConnection: close\r\n\r\n")
                if not (await reader.read()).startswith(b"HTTP/1.1 200"):
                    raise OSError

    took_s = [each for each in await asyncio.gather(*(one() for _ in range(PHONES))) if each]
    print(json.dumps({"phones": len(took_s), "slowest_s": max(took_s, default=0.0)}), flush=True)


class Child:
    """A process of this benchmark; `ask` sends a line and returns its answer."""

    def __init__(self, file: Path, *words: str, preferred: int = 0) -> None:
        command = [sys.executable, str(file), *words]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, start_new_session=True, **pipes)
        prefer(self.process.pid, preferred)

    def ask(self) -> dict:
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return self.read()

    def read(self) -> dict:
        return json.loads(self.process.stdout.readline())

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


def prefer(pid: int, steps: int) -> None:
    """Schedule a process as if nothing but this benchmark ran here; the front end, which is nicer, `steps` later."""
    with contextlib.suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(-20 + steps))


@contextlib.contextmanager
def limited(pid: int):
    """Stop a process whenever it has used more than its share of a core."""
    over = threading.Event()

    def watch() -> None:
        budget_s, before_s, used_s = 0.05, time.monotonic(), cpu_s(pid)
        while not over.wait(0.01):
            now_s, now_used_s = time.monotonic(), cpu_s(pid)
            budget_s = min(0.05, budget_s + (now_s - before_s) * CORE_SHARE - (now_used_s - used_s))
            before_s, used_s = now_s, now_used_s
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT if budget_s > 0 else signal.SIGSTOP)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def measure(
    seconds: float,
    only: str = "",
    gateway_file: Path = HERE,
    attack_file: Path = ATTACKS,
    front_steps: int = 5,
):
    """Yield a row for each phase."""
    us = str(os.getpid())
    serving = Child(gateway_file, "gateway", us)
    ready = serving.read()
    where = (us, str(ready["port"]), ready["code"])
    driving = Child(gateway_file, "visitors", *where, ready["ticket"])
    time.sleep(4)
    fronts = children(ready["pid"])
    for pid in fronts:
        prefer(pid, front_steps)
    try:
        for name, kinds, addresses in PHASES:
            if only not in name:
                continue
            with contextlib.ExitStack() as stack:
                attacking = None
                if kinds:
                    attacking = Child(attack_file, us, kinds, str(ready["port"]), addresses, ready["code"])
                    stack.callback(attacking.end)
                    stack.enter_context(limited(attacking.process.pid))
                    time.sleep(1)
                serving.ask(), driving.ask()
                pids = [ready["pid"], *fronts, *([attacking.process.pid] if attacking else [])]
                before = {pid: (cpu_s(pid), in_line_s(pid)) for pid in pids}
                began_s = time.monotonic()
                time.sleep(seconds)
                took_s = time.monotonic() - began_s
                used = {pid: (cpu_s(pid) - before[pid][0]) / took_s for pid in pids}
                row = {"attack": name} | serving.ask() | driving.ask()
                row |= {
                    "gateway_cpu": used[ready["pid"]],
                    "front_cpu": sum(used[pid] for pid in fronts),
                    "attackers_cpu": used[attacking.process.pid] if attacking else 0.0,
                    "waited": (in_line_s(ready["pid"]) - before[ready["pid"]][1]) / took_s,
                    "front_waited": sum(in_line_s(pid) - before[pid][1] for pid in fronts) / took_s,
                    "front_mb": sum(map(rss_mb, fronts)),
                }
                if name in WITH_PHONES:
                    coming = Child(gateway_file, "phones", *where)
                    row |= coming.read()
                    coming.end()
                row["attackers"] = json.dumps(attacking.ask()) if attacking else ""
                yield row
            time.sleep(1)
    finally:
        driving.end()
        serving.end()


COLUMNS = (
    ("attack", "attack", "{}"),
    ("gap_s", "longest gap, s", "{:.2f}"),
    ("p99_s", "p99, s", "{:.3f}"),
    ("stop_s", "slowest stop, s", "{:.3f}"),
    ("late_s", "tick late, s", "{:.3f}"),
    ("sent_late_s", "sent late, s", "{:.3f}"),
    ("join_s", "newcomer in, s", "{:.2f}"),
    ("join_failed", "failed", "{}"),
    ("phones", "of 50 phones", "{}"),
    ("slowest_s", "slowest, s", "{:.1f}"),
    ("gateway_cpu", "gateway, core", "{:.2f}"),
    ("front_cpu", "front end, core", "{:.2f}"),
    ("front_mb", "MB", "{:.0f}"),
    ("attackers_cpu", "attackers, core", "{:.2f}"),
    ("waited", "gateway waited", "{:.2f}"),
    ("front_waited", "front end waited", "{:.2f}"),
)


def table(rows: list[dict]) -> str:
    lines = ["| " + " | ".join(title for _, title, _ in COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    lines += [
        "| " + " | ".join((form.format(row[key]) if key in row else "") for key, _, form in COLUMNS) + " |"
        for row in rows
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--only", default="", help="of the attacks, those whose name has this in it")
    chosen = parser.parse_args()
    rows = []
    for row in measure(chosen.seconds, chosen.only):
        rows.append(row)
        print(f"{row['attack']}: {row['attackers']}", file=sys.stderr, flush=True)
    print(table(rows))
    if chosen.csv:
        with chosen.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    if sys.argv[1:2] in (["gateway"], ["visitors"], ["phones"]):
        role, parent, *words = sys.argv[1:]
        end_with_parent(int(parent))
        if role == "gateway":
            with tempfile.TemporaryDirectory() as folder:
                Path(folder, "index.html").write_bytes(bytes(20_000))
                asyncio.run(gateway(Path(folder)))
        else:
            asyncio.run(
                Visitors(int(words[0]), *words[1:]).run() if role == "visitors" else phones(int(words[0]), words[1])
            )
    else:
        main()
