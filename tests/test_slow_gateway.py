"""A gateway that hears less than visitors say: the guard passes on what it keeps up with, and whose turn it is."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time

import pytest

from conftest import a_gateway
from phalanx.io import Client
from phalanx.io.heard import TELL_S, Heard
from phalanx.io.pace import LEAST_PER_S, MOST_PER_S, HousePace
from phalanx.link import Pin, derive_epoch
from phalanx.link.envelope import encode_envelope, seal
from test_strangers import Stranger

RUNS_S, RESTS_S = 0.02, 0.08
CONNECTIONS, PER_S, MOVES = 60, 900, 25


class Slowed:
    """The process gets a fifth of a core, as long as the context lasts."""

    def __init__(self, pid: int) -> None:
        self._pid, self._over = pid, threading.Event()
        self._thread = threading.Thread(target=self._hold_back)

    def _hold_back(self) -> None:
        while not self._over.is_set():
            os.kill(self._pid, signal.SIGSTOP)
            time.sleep(RESTS_S)
            os.kill(self._pid, signal.SIGCONT)
            self._over.wait(RUNS_S)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()


@pytest.mark.waits
async def test_who_says_more_than_a_slow_gateway_hears_costs_others_few_moves():
    with a_gateway("--robots", "4") as (up, ready):
        epoch, over = derive_epoch(Pin(ready["pin"])), threading.Event()
        topic = f"/qrkey/{ready['topic']}/command/0000/NOBODY/0/move_raw"

        def attack(crowd: list[Stranger]) -> None:
            words, began_s, n = encode_envelope({"left_y": 1}, time.time()), time.monotonic(), 0
            while not over.wait(0.01):
                for n in range(n, int((time.monotonic() - began_s) * PER_S)):  # noqa: B020  # goes on there
                    crowd[n % CONNECTIONS].publish(topic, seal(words, epoch, os.urandom(12)))

        async with Client(ready["qr_url"], timeout_s=30) as driver:
            address = (await driver.request(0, frames=True, timeout_s=30))[0]["address"]
            crowd = [Stranger(ready["broker_port"], 4).__enter__() for _ in range(CONNECTIONS)]
            attacking = asyncio.create_task(asyncio.to_thread(attack, crowd))
            try:
                with Slowed(up.process.pid):
                    await asyncio.sleep(2)
                    for n in range(MOVES):
                        wheels = {"left_x": 0, "left_y": n + 1, "right_x": 0, "right_y": 1}
                        await driver.command(address, "move_raw", wheels)
                        await asyncio.sleep(0.1)
                    await asyncio.sleep(1)
            finally:
                over.set()
                await attacking
                for one in crowd:
                    one.socket.close()
            await asyncio.sleep(0.5)
            obeyed = len(up.events("command"))
        assert obeyed >= MOVES // 4, f"{obeyed} of {MOVES}; none, when all was passed on that a fast one hears"


class TestThePaceOfAll:
    def words_of_a_second(self, pace: HousePace, heard: Heard, now_s: float, unread_s: float) -> int:
        """That are passed on from `now_s` on, by a gateway whose oldest message is always so old."""
        said = 0
        for tick in range(1000):
            at_s = now_s + tick / 1000
            heard.tell(at_s, at_s - unread_s, 0)
            while not pace.wait_s(at_s):
                pace.said()
                said += 1
        return said

    def test_it_is_that_of_a_fast_machine_until_the_gateway_falls_behind_and_again_when_it_is_not(self, tmp_path):
        heard = Heard(tmp_path / "heard")
        pace = HousePace(heard)
        assert self.words_of_a_second(pace, heard, 100.0, 0.0) == pytest.approx(1.5 * MOST_PER_S, rel=0.02)
        assert self.words_of_a_second(pace, heard, 101.0, 0.5) < MOST_PER_S / 2
        assert self.words_of_a_second(pace, heard, 102.0, 0.5) < 4 * LEAST_PER_S
        assert 0 < self.words_of_a_second(pace, heard, 103.0, 0.5) <= LEAST_PER_S + 2
        back = [self.words_of_a_second(pace, heard, 104.0 + n, 0.0) for n in range(8)]
        assert back == sorted(back)
        assert back[-1] >= MOST_PER_S

    def test_who_tells_nothing_any_more_is_behind_and_who_never_did_or_has_ended_is_not(self, tmp_path):
        gateway, guard = Heard(tmp_path / "heard"), Heard(tmp_path / "heard")
        assert guard.behind_s(100.0) == 0.0
        gateway.tell(100.0, 99.0, 3)
        assert guard.behind_s(100.0) == pytest.approx(1.0 - TELL_S)
        assert guard.questions == 3
        gateway.tell(100.0, 100.0, 0)
        assert guard.behind_s(100.0) == 0.0
        assert guard.behind_s(103.0) == pytest.approx(3.0 - TELL_S)
        gateway.forget()
        assert guard.behind_s(103.0) == 0.0
