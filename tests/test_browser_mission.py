"""A mission on the pages, in a real browser: walls, landmarks that light up as robots decode them, and the editor."""

from __future__ import annotations

import pytest

from chromium import PHONE, a_page, badge, barriers_in_both_schemes, choose, join, pixels
from mission_swarms import SMALL, THROUGH, a_mission_gateway
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(600)]

DESK = {"viewport": {"width": 1280, "height": 900}}
SCREEN = "(svg, [x, y]) => { const p = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM()); return [p.x, p.y]; }"


@pytest.fixture
def files(tmp_path):
    world, mission = tmp_path / "small.yaml", tmp_path / "through.yaml"
    world.write_text(SMALL)
    mission.write_text(THROUGH)
    return str(world), str(mission)


def words(page, state: str, timeout_s: float = 60) -> str:
    found = page.locator(f"[data-testid=mission][data-state={state}]")
    found.wait_for(timeout=timeout_s * 1000)
    return found.inner_text()


def tap(desk, x_m: float, y_m: float) -> None:
    """On the editor's map, whose building is 6 m high."""
    desk.mouse.click(*desk.get_by_test_id("editor-map").evaluate(SCREEN, [x_m, 6 - y_m]))


def test_walls_are_drawn_and_landmarks_light_up_as_they_are_decoded(browser, files, tmp_path):
    with a_mission_gateway("--world", files[0]) as (up, ready), a_page(browser, **PHONE) as phone:
        join(phone, ready["qr_url"])
        badge(phone, "live")
        assert "wait for a mission" in words(phone, "waiting")
        wait_until(lambda: pixels(phone, 0, "--wall") > 500, 15)
        assert pixels(phone, 0, "--lit") == 0
        assert phone.get_by_test_id("joystick").count() == 0
        assert phone.get_by_test_id("route-start").count() == 0
        choose(phone, "Bo")
        with a_page(browser, **DESK) as desk:
            desk.goto(ready["operator_url"])
            desk.get_by_test_id("to-editor").click()
            desk.locator("summary").click()
            desk.get_by_test_id("yaml").fill(THROUGH)
            desk.get_by_test_id("import").click()
            desk.locator("[data-node=door]").wait_for()
            assert desk.get_by_test_id("mission-name").input_value() == "through"
            desk.get_by_test_id("compile").click()
            desk.get_by_test_id("audit").wait_for()
            desk.get_by_test_id("send").click()
            wait_until(lambda: pixels(phone, 0, "--lit") > 50, 30)
            one = pixels(phone, 0, "--lit")
            assert "1 of 2 steps unlocked" in words(phone, "running")
            phone.screenshot(path=tmp_path / "running.png")
            assert not barriers_in_both_schemes(phone) + barriers_in_both_schemes(desk)
            assert "Mission completed: 2 of 2 steps unlocked" in words(phone, "done", 120)
            assert pixels(phone, 0, "--lit") > 1.5 * one
            assert "Bo: mission completed, 2 of 2 steps unlocked" in words(phone, "done")
            assert phone.evaluate("document.documentElement.scrollWidth") == 390
            phone.screenshot(path=tmp_path / "done.png")
            desk.get_by_test_id("to-editor").click()
            desk.get_by_test_id("mission-card").get_by_text("4 of 4 robots completed").wait_for()
            assert desk.get_by_test_id("fleet-table").get_by_text("done").count() == 4
        assert [e["what"] for e in up.events("mission")].count("completed") == 4
        # Who comes late, or comes back, is told all that was decoded.
        phone.reload()
        badge(phone, "live")
        words(phone, "done")
        wait_until(lambda: pixels(phone, 0, "--lit") > 1.5 * one, 15)


def test_an_operator_draws_a_mission_compiles_audits_and_sends_it(browser, files, tmp_path):
    world, mission = files
    with (
        a_mission_gateway("--mission", mission, "--world", world, "--robots", "1") as (up, ready),
        a_page(browser, **DESK) as desk,
    ):
        desk.goto(ready["operator_url"])
        desk.get_by_test_id("to-editor").click()
        desk.get_by_test_id("editor-map").wait_for()
        desk.get_by_test_id("stop-all").click()
        desk.get_by_test_id("let-go").wait_for()
        box = desk.get_by_test_id("stop-all").bounding_box()
        assert box["y"] >= 8, "clear of the edge"
        assert box["x"] + box["width"] <= 1280 - 8
        for _ in range(2):
            desk.get_by_test_id("to-editor").click()  # which nothing covers
        desk.get_by_test_id("let-go").click()
        desk.get_by_test_id("let-go").wait_for(state="detached")
        assert desk.locator("[data-node]").all_text_contents() == ["start", "door"], "what runs"
        assert desk.get_by_test_id("mission-name").input_value() == "through"
        desk.go_back()
        desk.get_by_test_id("mission-card").wait_for()
        desk.go_forward()
        desk.get_by_label("Remove door").click()
        # Snapped: a finger is not that exact.
        tap(desk, 5.1, 2.9)
        assert desk.locator("[data-node]").all_text_contents() == ["start", "door1"]
        desk.get_by_test_id("tool-place").click()
        tap(desk, 7.0, 5.0)
        tap(desk, 6.5, 1.5)
        desk.get_by_test_id("undo").click()
        desk.get_by_test_id("tool-way").click()
        tap(desk, 1.5, 3.0)
        tap(desk, 5.0, 3.0)
        tap(desk, 7.0, 5.0)
        assert desk.get_by_test_id("ways").locator("li").count() == 2
        desk.get_by_label("place1 is final").click()
        desk.get_by_label("Name of door1").fill("the door")
        desk.get_by_label("Name of door1").press("Enter")
        desk.get_by_test_id("ways").get_by_text("the door ↔ place1").wait_for()
        desk.get_by_test_id("mission-name").fill("round the corner")
        assert desk.get_by_test_id("send").is_disabled()
        desk.get_by_test_id("compile").click()
        audit = desk.get_by_test_id("audit")
        audit.wait_for(timeout=30_000)
        assert audit.get_by_role("row").count() == 1 + 3 + 3
        assert "> 2^128" in audit.inner_text()
        assert "without the start key no node can be opened" in audit.inner_text()
        desk.screenshot(path=tmp_path / "editor.png", full_page=True)
        assert not barriers_in_both_schemes(desk)
        desk.get_by_test_id("send").click()
        begun = up.wait_for("mission", count=[e["what"] for e in up.events("mission")].count("decoded") + 2)
        wait_until(lambda: [e for e in up.events("mission") if e["what"] == "begun"][1:], 20)
        assert [e for e in up.events("mission") if e["what"] == "begun"][1]["name"] == "round the corner", begun
        wait_until(lambda: up.events("mission")[-1]["what"] == "completed", 90)
        decoded = [e["name"] for e in up.events("mission") if e["what"] == "decoded"]
        assert decoded[-3:] == ["start", "the door", "place1"]
        # A change makes what was compiled old; what does not compile says why.
        desk.get_by_label("start is a start").click()
        assert "compile it again" in desk.get_by_test_id("mission-status").inner_text()
        assert desk.get_by_test_id("send").is_disabled()
        desk.get_by_test_id("compile").click()
        trouble = desk.get_by_test_id("mission-trouble")
        trouble.wait_for()
        assert "no node is marked as a start" in trouble.inner_text()
        assert "Hint: add start: true to one node" in trouble.inner_text()
        assert not barriers_in_both_schemes(desk)


def test_the_editor_can_be_used_by_keyboard_alone_and_on_a_phone(browser, files):
    with a_mission_gateway("--world", files[0]) as (_, ready), a_page(browser, **PHONE, color_scheme="dark") as page:
        page.goto(ready["operator_url"])
        page.get_by_test_id("to-editor").press("Enter")
        page.get_by_test_id("add-site").press("Enter")
        page.get_by_test_id("way-to").select_option("door1")
        page.get_by_test_id("connect").press("Enter")
        page.get_by_label("door1 is final").press("Space")
        page.get_by_test_id("compile").press("Enter")
        page.get_by_test_id("audit").wait_for(timeout=30_000)
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        # A look at the overview loses nothing.
        page.get_by_test_id("to-editor").press("Enter")
        page.get_by_test_id("fleet-table").wait_for()
        page.get_by_test_id("to-editor").press("Enter")
        assert page.get_by_test_id("nodes").locator("li").count() == 2
        page.get_by_label("Remove door1").press("Enter")
        assert page.get_by_test_id("ways").locator("li").count() == 0
        page.get_by_test_id("undo").press("Enter")
        assert page.get_by_test_id("ways").locator("li").count() == 1
