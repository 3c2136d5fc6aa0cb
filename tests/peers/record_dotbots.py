"""Records what PyDotBot's controller says, for tests that have none: into tests/data/pydotbot.json.

    pip install pydotbot==0.33.0
    dotbot run simulator --headless --robots 3 --controller-http-port 8000
    python tests/peers/record_dotbots.py http://127.0.0.1:8000

Each step is some orders, and what the controller told on its stream in the time after them.
"""

import asyncio
import json
import sys
import time
from pathlib import Path

import aiohttp

FILE = Path(__file__).parent.parent / "data" / "pydotbot.json"


def order(cmd: str, address: str, data: dict) -> dict:
    return {"cmd": cmd, "address": address, "application": 0, "data": data}


def wheels(address: str, left: int, right: int) -> dict:
    return order("move_raw", address, {"left_x": 0, "left_y": left, "right_x": 0, "right_y": right})


def route(address: str, threshold: int, *points: tuple[float, float]) -> dict:
    return order("waypoints", address, {"threshold": threshold, "waypoints": [{"x": x, "y": y} for x, y in points]})


async def hear(stream: aiohttp.ClientWebSocketResponse, for_s: float) -> list[dict]:
    told, until_s = [], time.monotonic() + for_s
    while (left_s := until_s - time.monotonic()) > 0:
        try:
            message = await stream.receive_json(timeout=left_s)
        except TimeoutError:
            break
        told.append(message)
        if message["type"] != "hello":
            await stream.send_json({"ack": message["seq"]})
    return told


async def record(url: str) -> dict:
    async with aiohttp.ClientSession(url) as session:
        async with session.get("/controller/build") as answer:
            build = await answer.json()
        async with session.get("/controller/site") as answer:
            site = await answer.json()
        async with (
            session.ws_connect("/controller/ws/stream?hz=10&trail=200") as stream,
            session.ws_connect("/controller/ws/dotbots") as orders,
        ):
            begins = await hear(stream, 1.0)
            a, b, _ = (robot["address"] for robot in begins[1]["robots"])
            steps = []
            for said, times, for_s in (
                ([order("rgb_led", a, {"red": 1, "green": 2, "blue": 3})], 1, 1.0),
                ([wheels(a, 60, 60)], 8, 1.5),
                ([route(b, 50, (1500.0, 1500.0), (300.0, 300.0))], 1, 2.0),
                ([wheels(b, 0, 0), route(b, 0)], 1, 1.5),
            ):
                for _ in range(times):
                    for each in said:
                        await orders.send_json(each)
                    await asyncio.sleep(0.1)
                steps.append({"orders": said, "told": await hear(stream, for_s)})
            async with session.delete(f"/controller/dotbots/{a}/positions") as answer:
                steps.append({"delete": a, "status": answer.status, "told": await hear(stream, 1.0)})
            await orders.send_json(wrong := route(a, 50, (-1.0, 5.0)))
            refused = {"orders": [wrong], "refusal": await orders.receive_json(timeout=2)}
    return {"build": build, "site": site, "begins": begins, "steps": steps, "refused": refused}


if __name__ == "__main__":
    FILE.write_text(json.dumps(asyncio.run(record(sys.argv[1])), separators=(",", ":")) + "\n")
