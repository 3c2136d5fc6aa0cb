"""The projector's page in a real browser: a way in that scans, who is here, no operator's functions, and its recovery."""

from __future__ import annotations

import json
import sys
import urllib.error
import urllib.request

import pytest
import zxingcpp

from chromium import a_page, barriers_in_both_schemes, insecure
from commands import a_gateway, called
from phalanx.gateway.up import UpOptions
from ports import free_port

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(180)]

WALL = {"viewport": {"width": 1280, "height": 800}}


def codes_in(page, path) -> set[str]:
    from PIL import Image

    page.screenshot(path=path, full_page=True)
    with Image.open(path) as picture:
        return {found.text for found in zxingcpp.read_barcodes(picture)}


def status(url: str, token: str, body: bytes | None = None) -> int:
    try:
        with urllib.request.urlopen(
            urllib.request.Request(url, body, headers={"Authorization": f"Bearer {token}"})
        ) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_visitors_see_the_way_in_and_it_comes_back_with_the_gateway(browser, tmp_path):
    port, state = free_port(), tmp_path / "state"
    (tmp_path / "password").write_text("behind;the,door\n")
    words = ("--defence", "hardened", "--robots", "6", "--operator-port", str(port), "--state", str(state))
    wifi = ("--wifi", "Museum Guests", "--wifi-password-file", str(tmp_path / "password"))
    with a_page(browser, **WALL) as wall:
        # While the gateway is away, the browser says so of each request.
        with a_gateway(*words, *wifi) as (up, ready):
            page, projector = ready["operator_url"].split("#token=")[0], ready["projector_url"].split("#token=")[1]
            wall.goto(ready["projector_url"])
            wall.get_by_text("0 visitors").wait_for()
            assert "token" not in wall.url
            assert codes_in(wall, tmp_path / "wall.png") == {
                ready["qr_url"],
                "WIFI:T:WPA;S:Museum Guests;P:behind\\;the\\,door;;",
            }
            assert not barriers_in_both_schemes(wall)
            assert wall.locator("button:visible").count() == 0, "it commands nothing"
            with a_page(browser) as phone:
                phone.goto(insecure(ready["qr_url"]))
                phone.get_by_role("button", name="Join").click()
                wall.get_by_text("1 visitor", exact=True).wait_for()
            assert [status(f"{page}api/{what}", projector) for what in ("projector", "projector/frames")] == [200] * 2
            assert [status(f"{page}api/{what}", projector, b"{}") for what in ("stop", "link/state")] == [401] * 2
            assert status(f"{page}api/projector", "0" * 32) == 401
            operator = ready["operator_url"].split("#token=")[1]
            shown = json.dumps(wall.evaluate("document.body.innerText")) + wall.content()
            assert operator not in shown
            assert "behind" not in shown + "".join(up.out + up.err)
            wall.route("**/api/projector*", lambda route: route.abort())
            wall.get_by_text("Back in a moment").wait_for()
        with a_gateway(*words) as (_, again):
            wall.unroute("**/api/projector*")
            wall.get_by_text("Back in a moment").wait_for(state="detached")
            assert codes_in(wall, tmp_path / "again.png") == {again["qr_url"]}
            wall.goto("about:blank")


def test_a_machine_on_no_network_says_that_phones_cannot_reach_it(monkeypatch):
    monkeypatch.setattr(sys.modules["phalanx.gateway.up"], "lan_address", lambda: "127.0.0.1")
    assert "phones cannot reach it" in UpOptions(host="0.0.0.0").unreachable
    assert UpOptions().unreachable == "", "nobody asked for phones"
    assert UpOptions(host="0.0.0.0", page_url="https://lab.example/").unreachable == ""
    monkeypatch.setattr(sys.modules["phalanx.gateway.up"], "lan_address", lambda: "192.168.1.7")
    assert UpOptions(host="0.0.0.0").unreachable == ""


def test_a_wifi_that_phones_cannot_join_is_refused(tmp_path):
    empty, short = tmp_path / "empty", tmp_path / "short"
    empty.write_text("\n")
    short.write_text("seven77\n")
    for words, said in (
        (("--wifi-password-file", str(short)), "without --wifi"),
        (("--wifi", "x" * 33), "1 to 32 bytes"),
        (("--wifi", "x", "--wifi-password-file", str(empty)), "is empty"),
        (("--wifi", "x", "--wifi-password-file", str(short)), "8 to 63 bytes"),
    ):
        done = called("up", "--port", "0", *words)
        assert (done.returncode, said in done.stderr) == (2, True), done.stderr
        assert "seven77" not in done.stderr
