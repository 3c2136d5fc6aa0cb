"""A visitor's phone on the direct transport, in a real browser, against a real gateway and its front end."""

from __future__ import annotations

from contextlib import contextmanager

import pytest

from chromium import a_page, badge, barriers_in_both_schemes, choose, insecure, join, qr_in
from commands import a_gateway
from operating import ask, visitors
from ports import free_port
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(180)]

RECORD_BYTES = 10 + 128 + 16
DESK = {"viewport": {"width": 1280, "height": 900}}
TABLET = {"viewport": {"width": 820, "height": 1180}, "has_touch": True}


@pytest.fixture
def gateway(state):
    with a_gateway("--robots", "6", "--seed", "4") as (up, ready):
        yield up, ready


@contextmanager
def a_visitor(browser, ready, name: str):
    with a_page(browser) as page:
        join(page, ready["qr_url"], name)
        badge(page, "live")
        yield page


def test_a_phone_joins_without_a_broker_drives_at_a_constant_rate_and_resumes(browser, gateway):
    up, ready = gateway
    with a_page(browser) as page:
        sent, loaded = [], []
        page.on("websocket", lambda ws: ws.on("framesent", lambda payload: sent.append(len(payload))))
        page.on("request", lambda request: loaded.append(request.url))
        page.goto(insecure(ready["qr_url"]))
        assert "#" not in page.url
        assert not barriers_in_both_schemes(page)
        page.get_by_test_id("nickname").fill("Grace")
        page.get_by_test_id("join").click()
        assert badge(page, "live") == "Live · 6 robots"
        assert page.get_by_test_id("me").inner_text() == "Grace"
        assert not [each for each in loaded if "mqtt" in each or "broker" in each], "the MQTT client is not needed"
        choose(page, "Ada")
        page.get_by_test_id("joystick").focus()
        page.keyboard.down("KeyW")
        wait_until(lambda: len(up.events("command")) > 5)
        page.get_by_text("Ada is yours").wait_for()
        assert not barriers_in_both_schemes(page)
        page.keyboard.up("KeyW")
        driven, before = len(up.events("command")), len(sent)
        wait_until(lambda: page.wait_for_timeout(50) or len(sent) > before + 20)
        assert len(up.events("command")) <= driven + 2, "it rests"
        hello, *records = sent
        assert hello != RECORD_BYTES
        assert set(records) == {RECORD_BYTES}, "at rest as large as when it drives"
        known = visitors()["Grace"]["visitor"]
        page.reload()
        badge(page, "live")
        assert page.get_by_test_id("me").inner_text() == "Grace"
        assert visitors()["Grace"]["visitor"] == known
        kept = page.evaluate("[localStorage.length, Object.keys(sessionStorage).filter((k) => k.includes('session'))]")
        assert kept[0] == 0, "on plain http in this tab alone"
        assert len(kept[1]) == 1


def test_who_is_removed_stays_out_and_comes_back_only_if_let_in(browser, gateway):
    _, ready = gateway
    with a_visitor(browser, ready, "Eve") as eve, a_visitor(browser, ready, "Ada") as ada:
        choose(eve, "Bo")
        eve.get_by_test_id("joystick").focus()
        eve.keyboard.down("KeyW")
        choose(ada, "Bo")
        ada.get_by_text("Eve drives it").wait_for()
        ask("remove", visitor=visitors()["Eve"]["visitor"])
        eve.get_by_text("The operator removed you").wait_for()
        assert not barriers_in_both_schemes(eve)
        eve.reload()
        badge(eve, "nocode")
        join(eve, ready["qr_url"], "Eve")
        eve.get_by_text("no longer valid").wait_for()
        assert badge(ada, "live"), "who is here stays"
        join(eve, ask("code")["url"], "Eve")
        eve.get_by_test_id("waiting").wait_for()
        assert not barriers_in_both_schemes(eve)
        ask("approve", visitor=visitors()["Eve"]["visitor"])
        badge(eve, "live")
        ask("role", visitor=visitors()["Eve"]["visitor"], role="watch")
        eve.get_by_text("You are watching").wait_for()
        assert eve.get_by_test_id("joystick").get_attribute("aria-disabled") == "true"
        ask("everybody_out")
        ada.get_by_text("ended this round").wait_for()


def test_a_second_tab_takes_over_and_the_first_says_so(browser, gateway):
    _, ready = gateway
    with a_visitor(browser, ready, "Ada") as page:
        copy = page.evaluate("JSON.stringify(sessionStorage)")
        other = page.context.new_page()
        other.goto(insecure(ready["page_url"]))
        other.evaluate("copy => Object.assign(sessionStorage, JSON.parse(copy))", copy)  # as duplicating a tab does
        other.reload()
        badge(other, "live")
        page.get_by_text("Continued in another tab").wait_for()
        # On plain http its secret is the one from before: the code admits it as somebody else.
        page.get_by_test_id("again").click()
        badge(page, "live")
        assert badge(other, "live")
        assert len({each.get_by_test_id("me").inner_text() for each in (page, other)}) == 2


def test_a_room_code_admits_one_and_then_changes(browser, gateway):
    _, ready = gateway
    room = ask("room", show=True)["room"]
    with a_page(browser) as page, a_page(browser) as late:
        for each in (page, late):
            each.goto(insecure(ready["page_url"]))
            each.get_by_test_id("room-code").fill(f"{room[:4]} {room[4:]}")
        page.get_by_test_id("room-join").click()
        badge(page, "live")
        assert ask("code")["room"] != room
        late.get_by_test_id("room-join").click()
        late.get_by_text("has changed").wait_for()


def test_the_operator_lets_in_gives_a_robot_and_removes_from_the_table(browser, gateway):
    _, ready = gateway
    with a_visitor(browser, ready, "Ada") as ada, a_page(browser, **DESK) as desk:
        desk.goto(ready["operator_url"])
        row = desk.locator(f"[data-visitor='{visitors()['Ada']['visitor']}']")
        row.get_by_test_id("robot-of").select_option(label="Fay")
        ada.get_by_text("Fay is yours").wait_for()
        assert not barriers_in_both_schemes(desk)
        desk.get_by_test_id("door").click()
        desk.get_by_text("newcomers wait for you").wait_for()
        with a_page(browser) as bob:
            join(bob, ready["qr_url"], "Bob")
            bob.get_by_test_id("waiting").wait_for()
            desk.get_by_label("Let Bob in").click()
            badge(bob, "live")
            row.get_by_test_id("remove").click()
            assert badge(ada, "live"), "one click only asks"
            row.get_by_test_id("remove").click()
            ada.get_by_text("The operator removed you").wait_for()
            desk.get_by_test_id("room-toggle").click()
            shown = desk.get_by_test_id("room-digits").inner_text()
            assert shown.replace(" ", "") == ask("code")["room"]


def test_a_picture_is_painted_before_stylesheet_and_script_are_there(browser, gateway):
    _, ready = gateway
    with a_page(browser) as page:
        held = []
        page.route("**/assets/*", lambda route: held.append(route))
        page.goto(insecure(ready["page_url"]), wait_until="commit")
        painted = "performance.getEntriesByName('first-contentful-paint').length"
        wait_until(lambda: page.wait_for_timeout(20) or page.evaluate(painted))
        assert len(held) >= 2
        assert page.get_by_role("img", name="Phalanx is loading").is_visible()
        for route in held:
            route.continue_()
        page.unroute("**/assets/*")
        badge(page, "nocode")


def test_a_tablet_is_an_operators_by_a_ticket_of_one_use_also_after_a_reload_and_a_restart(browser, state):
    options = ("--robots", "6", "--seed", "4", "--port", str(free_port()))
    with a_page(browser, **TABLET) as tablet:
        with a_gateway(*options) as (up, _):
            url = insecure(ask("invite", role="operate", name="Tablet")["url"])
            tablet.goto(url)
            tablet.get_by_label("Map with 6 robots").wait_for()
            assert "#" not in tablet.url
            assert not barriers_in_both_schemes(tablet)
            tablet.get_by_test_id("stop-all").click()
            up.wait_for("held")
            tablet.get_by_test_id("let-go").click()
            up.wait_for("released")
            tablet.reload()
            tablet.get_by_label("Map with 6 robots").wait_for()
            assert list(visitors()) == ["Tablet"], "the same visitor"
            ask("everybody_out")
            with a_page(browser) as thief:
                thief.goto(url)
                thief.get_by_text("is not valid, or was used before").wait_for()
            up.stop()
        tablet.get_by_test_id("banner").wait_for()
        with a_gateway(*options) as (up, _):
            tablet.get_by_test_id("banner").wait_for(state="detached")
            tablet.get_by_test_id("stop-all").click()
            up.wait_for("held")
            assert list(visitors()) == ["Tablet"]


def test_the_page_of_this_machine_makes_a_tablet_an_operators(browser, gateway, tmp_path):
    _, ready = gateway
    with a_page(browser, **DESK) as desk, a_page(browser, **TABLET) as tablet:
        desk.goto(ready["operator_url"])
        desk.get_by_test_id("tablet").click()
        desk.get_by_text("Whoever scans this code becomes an operator").wait_for()
        assert not barriers_in_both_schemes(desk)
        desk.locator(".tablet").screenshot(path=tmp_path / "tablet.png")
        tablet.goto(insecure(qr_in(tmp_path / "tablet.png")))
        tablet.get_by_test_id("stop-all").wait_for()
        assert tablet.get_by_test_id("tablet").count() == 0, "it makes no operators"
        desk.get_by_test_id("session-table").get_by_text("operate").nth(1).wait_for()
