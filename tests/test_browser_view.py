"""`phalanx sim view` in a real browser: play, pause, scrub, speed; shields and refusals are there to see."""

from __future__ import annotations

import asyncio
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from subprocess import PIPE, Popen

import pytest

from chromium import PHONE, a_page, barriers_in_both_schemes, pixels
from commands import PHALANX
from phalanx.gateway.serve_view import ViewPages
from phalanx.net.site import serve_in_thread
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.scenes import Live
from recorded_scenario import SCENARIO
from waiting import in_real_time, wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]


@contextmanager
def served():
    """The page without a run, yet."""
    in_real_time()
    with ThreadPoolExecutor(1) as elsewhere:  # Playwright's own loop runs in this thread
        runner, site = asyncio.Runner(), serve_in_thread(ViewPages(0))
        try:
            yield elsewhere.submit(runner.run, site.__aenter__()).result()
        finally:
            elsewhere.submit(runner.run, site.__aexit__(None, None, None)).result()
            elsewhere.submit(runner.close).result()


def clock(page) -> float:
    return float(page.get_by_test_id("clock").inner_text().split()[0])


def test_a_run_plays_as_it_comes_stands_still_and_goes_where_it_is_told(browser, tmp_path):
    with served() as pages, a_page(browser, **PHONE, reduced_motion="no-preference") as page:
        live = Live(SCENARIO, pages.put)
        page.goto(f"http://127.0.0.1:{pages.port}/")
        page.get_by_test_id("loaded").get_by_text("so far").wait_for()
        run_scenario(SCENARIO, None, lambda run: live.write(run, run.new_verdicts()))
        live.end()
        pages.put(None)
        page.get_by_test_id("loaded").get_by_text("all 17 s received").wait_for()
        wait_until(lambda: clock(page) > 0.3)
        page.get_by_test_id("play").click()
        stood = clock(page)
        assert pixels(page, 1, "--bad") == 0, "nobody was refused yet"
        assert clock(page) == stood, "paused"
        refused = page.get_by_test_id("events").get_by_text(re.compile("robot 4: refused a token by robot"))
        assert refused.count() == 0
        page.get_by_label("Time").fill("17")
        refused.first.wait_for()
        page.get_by_test_id("events").get_by_text("robot 4: in Safe Mode").wait_for()
        page.get_by_test_id("events").get_by_role("button").last.click()
        first = clock(page)
        assert 2 < first < 17
        wait_until(lambda: refused.count() >= 1)
        assert pixels(page, 1, "--bad") > 50, "the first refusal's line and cross"
        assert pixels(page, 1, "--good") > 200, "tokens"
        page.screenshot(path=tmp_path / "refused.png")
        page.get_by_label("Speed").select_option("8")
        page.get_by_test_id("play").click()
        page.get_by_role("button", name="Play").wait_for()
        assert clock(page) == pytest.approx(SCENARIO.duration_s, abs=0.06), "it ends, and stands"
        page.screenshot(path=tmp_path / "ended.png")
        assert pixels(page, 1, "--unlit") > 30, "who was stopped is grey, what its cross leaves of it"
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        box = page.get_by_test_id("map").bounding_box()
        play_box = page.get_by_test_id("play").bounding_box()
        assert box["y"] + box["height"] < play_box["y"] < 844 - 46, "map and controls fit a phone"
        assert not barriers_in_both_schemes(page)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_serves_a_scenario_of_its_own_and_ctrl_c_ends_it(browser, number):
    command = [*PHALANX, "sim", "view", "bti-fig9", "--duration", "40"]
    with (
        Popen(command, stdout=PIPE, stderr=PIPE, text=True) as running,
        a_page(browser, **PHONE, reduced_motion="no-preference") as page,
    ):
        page.goto(running.stdout.readline().strip())
        page.get_by_test_id("loaded").get_by_text("all 40 s").wait_for(timeout=60_000)
        page.get_by_label("Time").fill("30")
        page.get_by_test_id("events").get_by_text("robot 14: in Safe Mode").wait_for()
        running.send_signal(number)
        assert "Traceback" not in running.communicate(timeout=20)[1]
        assert running.returncode == 0
        page.get_by_test_id("play").click()
        wait_until(lambda: clock(page) > 30.2)
