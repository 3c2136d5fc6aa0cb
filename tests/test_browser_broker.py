"""A visitor's phone whose code names a broker, in a real browser, against a real gateway and a real mosquitto."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from brokers import bare_mosquitto
from chromium import a_page, badge, barriers_in_both_schemes, choose, join
from commands import a_gateway
from operating import ask, visitors
from phalanx.gateway.serve_pages import PAGES
from ports import free_port
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(180)]


def test_a_phone_joins_by_a_broker_drives_stops_resumes_and_is_removed(browser, state):
    with a_gateway("--robots", "6", "--seed", "4", "--broker", "mosquitto") as (up, ready):
        with a_page(browser) as page:
            opened, loaded, sent = [], [], []
            page.on("websocket", lambda ws: opened.append(ws.url) or ws.on("framesent", lambda p: sent.append(len(p))))
            page.on("request", lambda request: loaded.append(request.url))
            join(page, ready["qr_url"], "Grace")
            assert badge(page, "live") == "Live · 6 robots"
            assert not barriers_in_both_schemes(page)
            assert [each for each in loaded if "broker_way" in each], "and MQTT with it"
            assert not [each for each in opened if each.endswith("/link")]
            choose(page, "Ada")
            page.get_by_test_id("joystick").focus()
            page.keyboard.down("KeyW")
            wait_until(lambda: len(up.events("command")) > 5)
            page.get_by_text("Ada is yours").wait_for()
            page.keyboard.up("KeyW")
            driven, before = len(up.events("command")), len(sent)
            wait_until(lambda: page.wait_for_timeout(50) or len(sent) > before + 20)
            assert len(up.events("command")) <= driven + 2, "it rests"
            assert len(set(sent[before:])) == 1, "at rest as large as when it drives"
            known = visitors()["Grace"]["visitor"]
            page.reload()
            badge(page, "live")
            assert visitors()["Grace"]["visitor"] == known
            ask("remove", visitor=known)
            page.get_by_text("The operator removed you").wait_for()
            join(page, ask("code")["url"], "Grace")
            page.get_by_test_id("waiting").wait_for()
            ask("approve", visitor=visitors()["Grace"]["visitor"])
            badge(page, "live")
            gone = len(up.events("left"))
            page.close()
            wait_until(lambda: len(up.events("left")) > gone)  # by its goodbye: silence takes 15 s


@contextmanager
def a_web_server(folder):
    """Files somewhere else than at the gateway."""
    handler = partial(SimpleHTTPRequestHandler, directory=folder)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/visitor/"
        server.shutdown()


def test_a_page_elsewhere_says_that_the_broker_is_lost_and_goes_on_when_it_is_back(browser, state, tmp_path):
    tcp, ws = free_port(), free_port()
    with bare_mosquitto(tcp, ws, tmp_path) as (start, kill), a_web_server(PAGES) as url:
        start()
        where = ("--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", f"ws://127.0.0.1:{ws}/mqtt", "--page-url", url)
        with a_gateway("--robots", "2", *where) as (_, ready), a_page(browser) as page:
            assert ready["qr_url"].startswith(f"{url}#j=")
            join(page, ready["qr_url"], "Ada")
            badge(page, "live")
            known = visitors()["Ada"]["visitor"]
            kill()
            assert f"127.0.0.1:{ws}" in badge(page, "offline")
            start()
            badge(page, "live")
            assert visitors()["Ada"]["visitor"] == known
