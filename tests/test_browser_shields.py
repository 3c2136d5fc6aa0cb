"""Shields on the pages, in a real browser: rings that drain, audits that flash, a robot that is stopped."""

from __future__ import annotations

import re
import time

import pytest

from chromium import BUZZED, PHONE, a_page, badge, barriers, choose, join, moves, pixels
from commands import a_gateway
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(600)]

# Pixels of the map's upper layer that have the colour of a variable of the stylesheet, or are fading from it.


def shield(page, state: str):
    return page.locator(f"[data-testid=shield][data-state={state}]")


def cut_off(page) -> int:
    """Lines of the shield's words that do not fit."""
    return page.evaluate(
        "[...document.querySelectorAll('[data-testid=shield] > *')].filter((p) => p.scrollWidth > p.clientWidth).length"
    )


def warned(page) -> bool:
    """Whether the shield's words are in the colour of warnings."""
    return page.evaluate(
        "() => { const is = document.createElement('i'); is.style.color = 'var(--warn)'; document.body.append(is);"
        " const [a, b] = [is, document.querySelector('[data-testid=shield] summary')].map((n) => getComputedStyle(n).color);"
        " is.remove(); return a === b; }"
    )


def obeys_nobody(page) -> bool:
    """Whether joystick, light and route are out of use."""
    others = page.locator(".swatch, .any-colour, [data-testid=route-toggle], [data-testid=trail-clear]")
    still = page.get_by_test_id("joystick").get_attribute("aria-disabled") == "true"
    return still and others.count() == 11 and not any(each.is_enabled() for each in others.all())


@pytest.mark.alone
def test_arcs_show_vouchers_a_refusal_flashes_and_the_liar_goes_grey(browser, tmp_path):
    with (
        a_gateway("--defence", "hardened", "--seed", "6") as (up, ready),
        a_page(browser, **PHONE, reduced_motion="no-preference") as phone,
        a_page(browser, viewport={"width": 1280, "height": 720}, reduced_motion="no-preference") as desk,
    ):
        join(phone, ready["qr_url"])
        badge(phone, "live")
        choose(phone, "Cleo")
        shield(phone, "whole").wait_for(timeout=15_000)
        assert shield(phone, "whole").inner_text().strip() == "Protected: 4 neighbours vouch for it"
        shield(phone, "whole").locator("summary").click()
        assert re.search(r"for a while: (\w+ \d+ s(, )?){4}\.", shield(phone, "whole").inner_text())
        assert cut_off(phone) == 0
        rings = pixels(phone, 1, "--good")
        assert rings > 12 * 40
        phone.screenshot(path=tmp_path / "whole.png")
        desk.goto(ready["operator_url"])
        desk.get_by_test_id("fleet-table").get_by_text(re.compile("4/4")).first.wait_for()
        assert "None so far." in desk.get_by_test_id("refusals").inner_text()
        assert desk.get_by_test_id("compromise-button").is_disabled(), "nobody is chosen"
        desk.get_by_test_id("victim").select_option(label="Cleo")
        assert desk.get_by_test_id("attack").input_value() == "hijack"
        desk.get_by_test_id("compromise-button").click()
        up.wait_for("compromised")
        desk.get_by_test_id("lies").get_by_text(re.compile(r"Cleo: hijack since \d s")).wait_for()
        assert desk.get_by_test_id("compromise-button").is_disabled(), "an impatient click does nothing"
        began = time.monotonic()
        wait_until(lambda: pixels(phone, 1, "--bad") > 100, 12)
        phone.screenshot(path=tmp_path / "refused.png")
        wait_until(lambda: pixels(desk, 1, "--bad") > 100)
        assert "Cleo lies" in desk.get_by_test_id("live-words").inner_text()
        shield(phone, "stopped").wait_for(timeout=15_000)
        assert time.monotonic() - began < 10 + 2
        desk.get_by_test_id("live-words").get_by_text("Cleo was stopped").wait_for()
        assert pixels(desk, 1, "--unlit") > 100
        assert desk.evaluate("window.scrollY") == 0, "an audience saw all of it on a projector"
        for part in ("qr", "map", "live-words", "stop-all"):
            box = desk.get_by_test_id(part).bounding_box()
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= 720, part
        assert "did not follow its program" in shield(phone, "stopped").inner_text()
        assert cut_off(phone) == 0
        assert obeys_nobody(phone)
        assert pixels(phone, 1, "--unlit") > 100
        assert up.wait_for("safe_mode")["address"].endswith("3")
        phone.screenshot(path=tmp_path / "stopped.png")
        assert not barriers(phone) + barriers(desk)
        desk.get_by_test_id("refusals").get_by_text("refused Cleo: output wrong").first.wait_for()
        row = desk.locator("tr[data-safe-mode=true]")
        row.wait_for()
        assert "Cleo" in row.inner_text()
        assert "hijack" in row.inner_text()
        assert desk.get_by_test_id("victim").locator("option").count() == 1 + 11
        desk.get_by_test_id("lies").get_by_text(re.compile(r"Cleo: hijack, stopped after \d+\.\d s")).wait_for()
        assert len(up.events("compromised")) == 1
        desk.screenshot(path=tmp_path / "operator.png", full_page=True)
        assert "hijack" not in phone.locator("body").inner_text()
        phone.reload()
        badge(phone, "live")
        choose(phone, "Cleo")
        shield(phone, "stopped").locator("summary").click()
        assert "did not follow its program" in shield(phone, "stopped").inner_text(), "who comes late is told why"
        choose(phone, "Ada")
        phone.locator("[data-testid=joystick][aria-disabled=false]").wait_for()


def test_a_stopped_robot_is_let_go_by_the_thumb_that_drives_it(browser):
    with (
        a_gateway("--defence", "hardened", "--scenario", "none") as (up, ready),
        a_page(browser, BUZZED, **PHONE) as phone,
        a_page(browser, viewport={"width": 1280, "height": 900}) as desk,
    ):
        join(phone, ready["qr_url"])
        badge(phone, "live")
        choose(phone, "Ada")
        phone.get_by_test_id("joystick").focus()
        phone.keyboard.down("KeyW")
        wait_until(lambda: moves(up, "0001"))
        desk.goto(ready["operator_url"])
        shield(phone, "whole").wait_for(timeout=20_000)
        desk.get_by_test_id("victim").select_option(label="Ada")
        desk.get_by_test_id("attack").select_option(label="crash")
        desk.get_by_test_id("compromise-button").click()
        shield(phone, "low").wait_for(timeout=20_000)
        # In three seconds it is stopped: what takes long comes last.
        assert phone.evaluate("window.buzzed.length") == 0
        assert warned(phone)
        assert pixels(phone, 1, "--warn") > 5, "short arcs"
        assert cut_off(phone) == 0
        assert not barriers(phone)
        shield(phone, "stopped").wait_for(timeout=20_000)
        assert not warned(phone)
        phone.get_by_test_id("news").get_by_text("Ada was stopped").wait_for()
        assert phone.evaluate("window.buzzed.length")
        wait_until(lambda: obeys_nobody(phone))
        sent = len(moves(up))
        assert sent > 50
        phone.wait_for_timeout(600)
        assert len(moves(up)) - sent <= 1, "the one that says that the stick is let go"


def test_who_wants_no_motion_sees_the_same_without_fading(browser):
    with a_gateway("--defence", "hardened") as (_, ready), a_page(browser, **PHONE) as phone:
        join(phone, ready["qr_url"])
        badge(phone, "live")
        wait_until(lambda: pixels(phone, 1, "--good") > 12 * 40, 15)


def test_the_joystick_stays_where_it_is_whatever_the_shield_says(browser):
    with a_gateway("--defence", "hardened") as (_, ready), a_page(browser) as phone:
        join(phone, ready["qr_url"])
        badge(phone, "live")
        choose(phone, "Ada")
        heights = set()
        for _ in range(20):
            phone.wait_for_timeout(500)
            heights.add(round(phone.get_by_test_id("joystick").bounding_box()["y"]))
        assert len(heights) == 1
        assert phone.evaluate("document.documentElement.scrollWidth") == 390
