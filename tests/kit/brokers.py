"""Real brokers on free ports, servers of mode qrkey, and whoever connects to them."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import time
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path

import aiomqtt

from phalanx.net import ANY, Server
from phalanx.net.broker import open_broker
from ports import free_port
from waiting import in_real_time


@asynccontextmanager
async def a_broker():
    """A mosquitto of ours on free ports."""
    in_real_time()
    async with open_broker("mosquitto", tcp_port=free_port(), ws_port=free_port()) as broker:
        yield broker


@contextmanager
def bare_mosquitto(tcp_port: int, ws_port: int, folder: Path, *more: str):
    """A mosquitto that nobody supervises: a broker of somebody else's. Yields a way to start and kill it."""
    config = folder / f"mosquitto-{tcp_port}.conf"
    lines = ["persistence false", *(more or ["allow_anonymous true"])]
    config.write_text(
        "\n".join(
            [*lines, f"listener {tcp_port} 127.0.0.1", f"listener {ws_port} 127.0.0.1", "protocol websockets", ""]
        )
    )
    in_real_time()
    running: list[subprocess.Popen] = []

    def start():
        env = os.environ | {"PATH": os.environ["PATH"] + ":/usr/sbin"}
        command = ["mosquitto", "-c", str(config)]
        # A port that was free may be some connection's by now, for a while.
        for _ in range(20):
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
            while process.poll() is None:
                with suppress(OSError), socket.create_connection(("127.0.0.1", ws_port)):  # the last that it opens
                    running.append(process)
                    return
                time.sleep(0.02)
            time.sleep(0.25)
        raise AssertionError(f"no mosquitto at {tcp_port} and {ws_port}")

    def kill():
        while running:
            process = running.pop()
            process.send_signal(signal.SIGKILL)
            process.wait()

    try:
        yield start, kill
    finally:
        kill()


def a_server(broker, **more) -> Server:
    """A server that keeps what it hears, and answers request 0."""
    server = Server(broker.url, broker_for_visitors=broker.websocket, **more)
    server.heard = []

    @server.on_command(ANY)
    def hear(command):
        server.heard.append((command.address, command.name, command.payload))

    @server.on_request(0)
    async def answer(request):
        return {"asked": request.words.get("what"), "robots": [1, 2]}

    return server


def somebody(broker) -> aiomqtt.Client:
    """A connection of whoever reaches the broker."""
    return aiomqtt.Client(broker.url.host, broker.url.port)


def with_an_old_pin(server, age_s: float):
    """`server`, whose first pin is `age_s` old when the broker is reached: one rotation is near, the next one far.

    With a short rotation instead, a busy machine would be given two where the test means one.
    """
    begin = server._side.restart_clock
    server._side.restart_clock = lambda uptime_s: begin(uptime_s - age_s)
    return server


async def tell_until_cancelled(server):
    """Notify everybody, ten times a second."""
    while True:
        await server.notify({"cmd": 1})
        await asyncio.sleep(0.1)
