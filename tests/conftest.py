"""Fixtures that tests of all folders share; helpers are in tests/kit."""

from __future__ import annotations

import logging
import os
import signal
from uuid import uuid4

import pytest
from hypothesis import HealthCheck, settings

from brokers import a_broker
from certificates import make_certificate
from chromium import CHROMIUM, FLAGS
from phalanx.cli.main import run_command
from waiting import RUNNING, in_real_time

# How long an example takes says how busy the machine is.
# Others than the last time: what is rare is found by many runs, and each of them is short.
settings.register_profile("beside others", deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("beside others")
# Whoever runs in the background of a shell does not hear Ctrl-C, nor does any program that is started from there.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def kernel_defects():
    """Log records of checks that failed while kernels read a peer's bytes: a test that clears them not, fails."""
    handler, records, logger = logging.Handler(), [], logging.getLogger("phalanx.kernel")
    handler.emit = records.append
    logger.addHandler(handler)
    yield records
    logger.removeHandler(handler)
    assert not [record.getMessage() for record in records]


@pytest.fixture(autouse=True, scope="session")
def states(tmp_path_factory):
    """A folder below which gateways keep what they keep, and not in somebody's home."""
    folder = tmp_path_factory.mktemp("states")
    os.environ["XDG_STATE_HOME"] = str(folder / "of modules")
    return folder


@pytest.fixture(autouse=True)
def state(states, monkeypatch):
    """One of each test's own: a gateway that another test has left behind has its own."""
    path = states / uuid4().hex
    monkeypatch.setenv("XDG_STATE_HOME", str(path))
    return path / "phalanx"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    RUNNING[:] = [item]


@pytest.fixture
async def broker():
    async with a_broker() as running:
        yield running


@pytest.fixture
def phalanx(capsys):
    """Exit code, stdout, stderr of a command."""

    def call(*words: str):
        code = run_command(list(words))
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture(scope="module")
def browser():
    in_real_time()
    playwright = pytest.importorskip("playwright.sync_api")
    assert CHROMIUM, "apt-get install chromium-headless-shell"
    flags = [*FLAGS, "--no-sandbox"] if os.geteuid() == 0 else FLAGS
    with playwright.sync_playwright() as p:
        running = p.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield running
        running.close()


@pytest.fixture
def pages(tmp_path):
    """A folder with the page that a front end serves."""
    folder = tmp_path / "pages"
    folder.mkdir()
    (folder / "index.html").write_text("<p>drive")
    return folder


@pytest.fixture
def tls(tmp_path):
    """Files of a certificate for localhost and its key."""
    return make_certificate(tmp_path)
