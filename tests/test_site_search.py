"""What people search for on the site is found: the built pages in a real browser."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FIRST = 5


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *said):
        """Print nothing."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the address of the site, built without the API's pages, which take long."""
    folder = tmp_path_factory.mktemp("site")
    config = folder / "mkdocs.yml"
    text, removed = re.subn(
        r"^  - mkdocstrings:\n(?:      .*\n)+", "", (ROOT / "mkdocs.yml").read_text(), flags=re.MULTILINE
    )
    assert removed == 1
    text = text.replace("docs_dir: docs", f"docs_dir: {ROOT / 'docs'}").replace("strict: true", "strict: false")
    config.write_text(f"{text}site_dir: {folder / 'site'}\n")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--config-file", str(config)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder / "site"))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.waits
@pytest.mark.parametrize(
    ("query", "page"),
    [
        ("nginx", "guides/https.html"),
        ("systemd", "guides/service.html"),
        ("own robot", "guides/own-robots.html"),
        ("kick a visitor", "guides/visitors.html"),
        ("no camera", "guides/visitors.html"),
    ],
)
def test_the_search_finds(browser, site, query, page):
    tab = browser.new_page()
    try:
        tab.goto(site)
        tab.fill("[data-md-component=search-query]", query)
        tab.wait_for_selector(".md-search-result__link", timeout=60_000)
        found = tab.eval_on_selector_all(
            ".md-search-result__item > .md-search-result__link", "links => links.map(link => link.href)"
        )
        assert any(link.startswith(site + page) for link in found[:FIRST]), found[:FIRST]
    finally:
        tab.close()
