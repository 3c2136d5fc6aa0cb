"""The recipes of docs/guides/https.md with the real Caddy, nginx and sshd: a visitor joins and drives through each."""

from __future__ import annotations

import asyncio
import getpass
import os
import re
import shlex
import shutil
import socket
import ssl
import subprocess
import time
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import aiohttp
import pytest

from commands import ROOT
from phalanx.link.session import parse_invitation
from phalanx.world import Dotbots
from ports import free_port
from serving import up_here
from session_front import visiting
from waiting import eventually

pytestmark = pytest.mark.waits

RECIPES, PAGE = ROOT / "deploy" / "https", ROOT / "docs" / "guides" / "https.md"
NAME = "swarm.example.org"
VISITOR = "127.0.0.9"


def program(name: str) -> str:
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
    assert found, f"{name} is missing: make setup-dev installs it"
    return found


def swapped(text: str, *pairs: tuple[str, str]) -> str:
    """Return a recipe for this machine; each of what is swapped is in it."""
    for before, after in pairs:
        assert before in text, before
        text = text.replace(before, after)
    return text


@contextmanager
def running(words: list[str], port: int, folder: Path):
    """A program that listens at a port, until the end."""
    said = folder / f"{Path(words[0]).name}.log"
    with said.open("wb") as log:
        process = subprocess.Popen(words, stdout=log, stderr=log, env=os.environ | {"HOME": str(folder)})
    try:
        until_s = time.monotonic() + 30
        while True:
            assert process.poll() is None, said.read_text()
            with socket.socket() as there:
                if there.connect_ex(("127.0.0.1", port)) == 0:
                    break
            assert time.monotonic() < until_s, said.read_text()
            time.sleep(0.05)
        yield
    finally:
        process.terminate()
        process.wait(10)


@contextmanager
def caddy(port: int, gateway: int, tls, folder: Path):
    text = swapped(
        (RECIPES / "Caddyfile").read_text(),
        (f"{NAME} {{", f"https://localhost:{port} {{\n\ttls {tls[0]} {tls[1]}"),
        ("127.0.0.1:8080", f"127.0.0.1:{gateway}"),
    )
    config = folder / "Caddyfile"
    config.write_text("{\n\tadmin off\n\tauto_https disable_redirects\n}\n" + text)
    words = [program("caddy"), "run", "--config", str(config), "--adapter", "caddyfile"]
    with running(words, port, folder):
        yield


@contextmanager
def nginx(port: int, gateway: int, tls, folder: Path):
    letsencrypt = f"/etc/letsencrypt/live/{NAME}"
    site = swapped(
        (RECIPES / "nginx.conf").read_text(),
        ("listen 443", f"listen 127.0.0.1:{port}"),
        ("    listen [::]:443 ssl;\n", ""),
        (f"server_name {NAME}", "server_name localhost"),
        (f"{letsencrypt}/fullchain.pem", str(tls[0])),
        (f"{letsencrypt}/privkey.pem", str(tls[1])),
        ("127.0.0.1:8080", f"127.0.0.1:{gateway}"),
    )
    (folder / "site.conf").write_text(site)
    temporary = "".join(
        f"    {kind}_temp_path {folder};\n" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    config = folder / "nginx.conf"
    config.write_text(
        f"daemon off;\nmaster_process off;\npid {folder}/nginx.pid;\nerror_log stderr;\nevents {{}}\n"
        f"http {{\n    access_log off;\n{temporary}    include {folder}/site.conf;\n}}\n"
    )
    with running([program("nginx"), "-p", str(folder), "-c", str(config)], port, folder):
        yield


@contextmanager
def tunnel(far: int, gateway: int, folder: Path):
    """sshd, and the command of the page beside it: the gateway's port is at `far`."""
    door = free_port()
    for key in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / key], check=True)
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # Debian's unit makes it
    (folder / "sshd_config").write_text(
        f"ListenAddress 127.0.0.1:{door}\nHostKey {folder}/host\nAuthorizedKeysFile {folder}/user.pub\n"
        "StrictModes no\nUsePAM no\nPasswordAuthentication no\nPidFile none\n"
    )
    (command,) = re.findall(r"^ssh -N -R .*\\\n.*$", PAGE.read_text(), re.MULTILINE)
    words = shlex.split(
        swapped(
            command.replace("\\\n", ""),
            ("127.0.0.1:8080:127.0.0.1:8080", f"127.0.0.1:{far}:127.0.0.1:{gateway}"),
            (f"you@{NAME}", f"{getpass.getuser()}@127.0.0.1"),
        )
    )
    trust = ["-o", "StrictHostKeyChecking=accept-new", "-o", f"UserKnownHostsFile={folder}/known"]
    own = ["-F", "none", "-p", str(door), "-i", str(folder / "user"), "-o", "IdentitiesOnly=yes", *trust]
    with (
        running([program("sshd"), "-D", "-e", "-f", str(folder / "sshd_config")], door, folder),
        running([program("ssh"), *own, *words[1:]], far, folder),
    ):
        yield


@asynccontextmanager
async def a_gateway(**options):
    swarm = Dotbots(2, 1, time.time)
    async with up_here(swarm, **options) as (gateway, ready):
        yield gateway, ready, swarm


async def drives_through(port: int, tls, running) -> None:
    """Load the page, join, drive, and be counted by one's own address."""
    gateway, ready, swarm = running
    context = ssl.create_default_context(cafile=str(tls[0]))
    more = {"ssl": context, "headers": {"X-Forwarded-For": "192.0.2.1"}}
    at_visitor = aiohttp.TCPConnector(local_addr=(VISITOR, 0))
    async with aiohttp.ClientSession(connector=at_visitor) as http:
        async with http.get(f"https://localhost:{port}/", **more) as page:
            assert page.status == 200
            assert "<html" in await page.text()
    code = parse_invitation(ready["qr_url"])
    async with visiting(port, code, "Ada", "localhost", source=VISITOR, **more) as ada:
        await eventually(lambda: ada.frames)
        began = swarm.robots()[0].at
        for _ in range(60):
            await ada.command(swarm.robots()[0].address, "move_raw", {"left_y": 60, "right_y": 60})
            await asyncio.sleep(0.05)
            if swarm.robots()[0].at != began:
                break
        assert swarm.robots()[0].at != began
        connection = gateway.link.server.connections.of_visitor(ada.visitor)
        assert connection.address == VISITOR


@pytest.mark.parametrize("proxy", [caddy, nginx])
async def test_a_visitor_joins_and_drives_through_a_proxy_and_is_counted_by_its_own_address(proxy, tls, tmp_path):
    port, gateway = free_port(), free_port()
    url = f"https://localhost:{port}/"
    async with a_gateway(port=gateway, behind_proxy=True, page_url=url) as served:
        assert served[1]["qr_url"].startswith(f"{url}#")
        with proxy(port, gateway, tls, tmp_path):
            await drives_through(port, tls, served)


@pytest.mark.parametrize("proxy", [caddy, nginx])
async def test_a_gateway_behind_nat_is_reached_by_ssh_and_the_proxy_at_its_end(proxy, tls, tmp_path):
    port, far, gateway = free_port(), free_port(), free_port()
    async with a_gateway(port=gateway, behind_proxy=True, page_url=f"https://localhost:{port}/") as served:
        with proxy(port, far, tls, tmp_path), tunnel(far, gateway, tmp_path):
            await drives_through(port, tls, served)


async def test_without_a_proxy_a_certificate_of_ones_own_is_enough(tls):
    port = free_port()
    async with a_gateway(port=port, tls=tls) as served:
        assert served[1]["qr_url"].startswith(f"https://127.0.0.1:{port}/#")
        await drives_through(port, tls, served)


def test_the_page_shows_the_recipe_that_is_tested():
    lines = (RECIPES / "Caddyfile").read_text().splitlines()
    recipe = "\n".join(line for line in lines if not line.strip().startswith("#"))
    assert f"```text\n{recipe}\n```" in PAGE.read_text()
