"""What somebody on the network sees of a visitor that drives, and classifiers that guess from it what it does.

Source: the attack that told forward from stop with 98 % accuracy and robots with 100 %, in mode qrkey.
"""

from __future__ import annotations

import asyncio
import math
import random
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field

import numpy as np

from phalanx.config.session import SessionConfig
from phalanx.gateway import Gateway
from phalanx.gateway.session_link import SessionLink
from phalanx.gateway.trail import Trail
from phalanx.link.session import MemoryStore
from phalanx.net.session_client import Client
from phalanx.net.session_store import new_link_keys
from phalanx.robot import Led, Point, Robot
from serving import meanwhile
from session_front import FakeFront

ROBOTS = ("A1", "ROBOT-NUMBER-2")  # of different length, as are their names
SEGMENT_S, WINDOW_S = 2.0, 0.5
FORWARD, STOP = "forward", "stop"


@dataclass(frozen=True)
class Seen:
    """A message on the network: when, whether to the gateway, and how long."""

    at_s: float
    up: bool
    size: int


@dataclass(frozen=True)
class Segment:
    """What the visitor did in a time."""

    from_s: float
    to_s: float
    action: str
    robot: str
    asks: bool


class RecordedFront(FakeFront):
    """A front end whose messages are seen."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[Seen] = []

    def send(self, connection, data):
        self.seen.append(Seen(time.monotonic(), False, len(data)))
        super().send(connection, data)

    async def events(self):
        async for event in super().events():
            if data := getattr(event, "data", b""):
                self.seen.append(Seen(time.monotonic(), True, len(data)))
            yield event


@dataclass
class Carts:
    """Two robots that drive in circles, so that none comes to an edge."""

    area_mm: tuple[int, int] = (4000, 4000)
    speed: dict[str, float] = field(default_factory=lambda: dict.fromkeys(ROBOTS, 0.0))
    turn: dict[str, float] = field(default_factory=lambda: dict.fromkeys(ROBOTS, 0.0))
    then_s: float = 0.0

    def robots(self) -> Sequence[Robot]:
        passed_s, self.then_s = time.monotonic() - self.then_s, time.monotonic()
        made = []
        for i, address in enumerate(ROBOTS):
            self.turn[address] += self.speed[address] * min(passed_s, 1.0)
            angle = self.turn[address]
            at = Point(1000 + 2000 * i + 500 * math.cos(angle), 2000 + 500 * math.sin(angle))
            direction = round(math.degrees(angle)) % 360
            made.append(Robot(address, f"name of {address}", at, direction, 3.0, Led(0, 0, 0), (), 60, time.time(), ()))
        return made

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        self.speed[address] = (left_pct + right_pct) / 200

    def stop(self, address: str) -> None:
        self.speed[address] = 0.0

    def hold(self) -> None:
        self.speed = dict.fromkeys(ROBOTS, 0.0)

    def release(self) -> None:
        pass

    def set_led(self, address, led) -> None:
        pass

    def follow(self, address, route, threshold_mm) -> None:
        pass

    def clear_history(self, address) -> None:
        pass


async def recorded(seed: int, for_s: float) -> tuple[list[Seen], list[Segment]]:
    """Return what is seen of one visitor of one gateway, and what the visitor did."""
    chance = random.Random(seed)
    swarm = Carts()
    async with RecordedFront() as front, AsyncExitStack() as stack:
        link = SessionLink(
            front, MemoryStore(), new_link_keys(), lambda: list(ROBOTS), Trail(None), SessionConfig(lease_ms=60_000)
        )
        await stack.enter_async_context(meanwhile(link.run(), Gateway(swarm, link).run()))
        url = f"http://127.0.0.1:{front.port}/#{link.invitation.fragment()}"
        async with Client(url, name="Ada") as client:
            segments, drives, robot = [], [], ""
            await asyncio.sleep(chance.random())  # its slots come at any time between the gateway's ticks
            end_s = time.monotonic() + for_s
            while time.monotonic() < end_s:
                if not robot or chance.random() < 0.4:
                    robot = chance.choice(ROBOTS)
                    await client.drive(robot, 10, 10, for_s=0.3)  # not looked at: who has which robot is told once
                action = chance.choice((FORWARD, STOP))
                began_s = time.monotonic()
                if action == FORWARD:
                    left, right = chance.randint(20, 100), chance.randint(20, 100)
                    drives.append(asyncio.create_task(client.drive(robot, left, right, for_s=3600)))
                else:
                    await client.stop(robot)
                asks = chance.random() < 0.5
                while asks and time.monotonic() < began_s + SEGMENT_S - WINDOW_S:
                    await asyncio.sleep(chance.uniform(0.1, 0.4))
                    await client.robots()
                await asyncio.sleep(began_s + SEGMENT_S - time.monotonic())
                segments.append(Segment(began_s, time.monotonic(), action, robot, asks))
            await client.stop(ROBOTS[0])
            await asyncio.gather(*drives)
            assert not client.refusals, client.refusals
    return front.seen, segments


async def windows(worlds: int, for_s: float, seed: int = 1) -> tuple[np.ndarray, list[Segment], np.ndarray]:
    """Return the features of each window, what was done in it, and in which world."""
    runs = await asyncio.gather(*(recorded(seed * 1000 + i, for_s) for i in range(worlds)))
    rows, done, world = [], [], []
    for number, (seen, segments) in enumerate(runs):
        for segment in segments:
            for i in range(int((segment.to_s - segment.from_s) / WINDOW_S)):
                from_s = segment.from_s + i * WINDOW_S
                inside = [each for each in seen if from_s <= each.at_s < from_s + WINDOW_S]
                rows.append(features(inside, from_s))
                done.append(segment)
                world.append(number)
    return np.array(rows, float), done, np.array(world)


def features(seen: list[Seen], from_s: float) -> list[float]:
    """Return numbers and spreads of sizes and of gaps, in each direction."""
    found: list[float] = []
    for up in (True, False):
        sizes = [each.size for each in seen if each.up == up] or [0]
        times = [each.at_s - from_s for each in seen if each.up == up] or [0.0]
        gaps = np.diff(times) if len(times) > 1 else np.zeros(1)
        found += [len(sizes), sum(sizes), min(sizes), max(sizes), float(np.std(sizes)), float(np.median(sizes))]
        found += [times[0], times[-1], float(gaps.mean()), float(gaps.std()), float(gaps.max()), float(gaps.min())]
    return found


def accuracy(rows: np.ndarray, labels: np.ndarray, groups: np.ndarray) -> dict[str, float]:
    """Return how often each classifier is right about worlds that it was not trained on, classes weighed equally."""
    folds = np.unique(groups)
    right: dict[str, list[list[float]]] = {}
    for fold in np.array_split(folds, min(4, len(folds))):
        test = np.isin(groups, fold)
        mean, spread = rows[~test].mean(0), rows[~test].std(0)
        spread[spread < 1e-9] = 1.0
        train_x, test_x = (rows[~test] - mean) / spread, np.clip((rows[test] - mean) / spread, -10, 10)
        for name, guess in CLASSIFIERS.items():
            said = guess(np.clip(train_x, -10, 10), labels[~test], test_x)
            for label in (0, 1):
                right.setdefault(name, [[], []])[label] += list(said[labels[test] == label] == label)
    return {name: float(np.mean([np.mean(each) for each in both])) for name, both in right.items()}


def nearest_centroid(train: np.ndarray, labels: np.ndarray, test: np.ndarray) -> np.ndarray:
    centres = [train[labels == label].mean(0) for label in (0, 1)]
    away = [np.linalg.norm(test - centre, axis=1) for centre in centres]
    return (away[1] < away[0]).astype(int)


def neighbours(train: np.ndarray, labels: np.ndarray, test: np.ndarray, k: int = 15) -> np.ndarray:
    away = ((test[:, None, :] - train[None, :, :]) ** 2).sum(2)
    nearest = np.argpartition(away, k, axis=1)[:, :k]
    return (labels[nearest].mean(1) > 0.5).astype(int)


def logistic(train: np.ndarray, labels: np.ndarray, test: np.ndarray) -> np.ndarray:
    x = np.hstack([train, np.ones((len(train), 1))])
    weights = np.zeros(x.shape[1])
    for _ in range(500):
        said = 1 / (1 + np.exp(-np.clip(x @ weights, -30, 30)))
        weights -= 0.3 * (x.T @ (said - labels) / len(x) + 1e-3 * weights)
    return (np.hstack([test, np.ones((len(test), 1))]) @ weights > 0).astype(int)


CLASSIFIERS = {"nearest centroid": nearest_centroid, "15 nearest neighbours": neighbours, "logistic": logistic}


def guesses(rows: np.ndarray, done: list[Segment], world: np.ndarray) -> tuple[dict[str, float], ...]:
    """Return how well forward and stop, the robots that are driven, and from records up whether it asks, are told."""
    forward = np.array([each.action == FORWARD for each in done])
    second = np.array([each.robot == ROBOTS[1] for each in done])
    asks = np.array([each.asks for each in done])
    up = rows[:, : rows.shape[1] // 2]  # a reply is seen
    return (
        accuracy(rows, forward.astype(int), world),
        accuracy(rows[forward], second[forward].astype(int), world[forward]),
        accuracy(up, asks.astype(int), world),
    )
