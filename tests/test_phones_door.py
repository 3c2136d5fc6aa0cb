"""Whether phones get in and through at a broker of somebody else's, in a real mosquitto with an access control."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import ssl
import subprocess
import time
import urllib.request

import pytest

from conftest import a_gateway, a_server, bare_mosquitto, called, child, eventually
from phalanx.io import Login, Server, parse_broker_url
from phalanx.io.broker import RunningBroker
from phalanx.io.mosquitto import password_line
from phalanx.io.phones import COMMAND, NUMBER, PhonesDoor
from phalanx.link import Command, Request
from ports import free_port

pytestmark = pytest.mark.waits

WRITE = ("topic write /qrkey/+/request", "topic write /qrkey/+/command/#")
READ = ("topic read /qrkey/+/notify", "topic read /qrkey/+/reply/+")
DEAF, MUTE = "nothing on /qrkey/+/{} reaches them", "nothing of theirs on /qrkey/+/{} reaches the gateway"
PHONES = {  # what each login may, and what the door says of it
    "all": ((*WRITE, *READ), ""),
    "reads": (READ, MUTE.format("request or /qrkey/+/command/#")),
    "writes": (WRITE, DEAF.format("notify or /qrkey/+/reply/+")),
    "nothing": ((), MUTE.format("request or /qrkey/+/command/#") + ", and " + DEAF.format("notify")),
    "no-commands": ((WRITE[0], *READ), MUTE.format("command/#")),
    "no-answers": ((*WRITE, READ[0]), DEAF.format("reply/+")),
    "no-notices": ((*WRITE, READ[1]), DEAF.format("notify")),
}


class Guarded:
    """A broker that knows the gateway and every one of PHONES."""

    def __init__(self, folder, start, kill, tcp, ws):
        self.start, self.kill, self.folder = start, kill, folder
        self.tcp, self.ws = f"mqtt://127.0.0.1:{tcp}", f"ws://127.0.0.1:{ws}/mqtt"
        self.let(PHONES)

    def let(self, phones) -> None:
        lines = ["user gateway", "topic readwrite /qrkey/#"]
        for name, (may, _) in phones.items():
            lines += [f"user {name}", *may]
        (self.folder / "acl").write_text("\n".join([*lines, ""]))

    def words(self, name: str) -> list[str]:
        for each in ("gateway", name):
            (self.folder / each).write_text(f"{each}:secret\n")
        logins = ("--broker-login", str(self.folder / "gateway"), "--visitors-login", str(self.folder / name))
        return ["--broker", self.tcp, "--broker-ws", self.ws, *logins]


@pytest.fixture
def guarded(tmp_path):
    tcp, ws = free_port(), free_port()
    users, acl = tmp_path / "users", tmp_path / "acl"
    users.write_text("".join(password_line(Login(name, "secret")) for name in ("gateway", *PHONES)))
    own = ("user root",) if os.geteuid() == 0 else ()  # or it would become somebody who may not read the test's files
    rules = (*own, "allow_anonymous false", f"password_file {users}", f"acl_file {acl}")
    with bare_mosquitto(tcp, ws, tmp_path, *rules) as (start, kill):
        broker = Guarded(tmp_path, start, kill, tcp, ws)
        start()
        yield broker


async def test_a_certificate_that_nobody_knows_is_not_told_as_a_wrong_password(tmp_path):
    key, certificate = str(tmp_path / "key"), str(tmp_path / "certificate")
    words = ["req", "-x509", "-newkey", "ed25519", "-nodes", "-subj", "/CN=me", "-keyout", key, "-out", certificate]
    subprocess.run(["openssl", *words], check=True, capture_output=True)
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    tls.load_cert_chain(certificate, key)
    async with await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0, ssl=tls) as listening:
        at = f"wss://127.0.0.1:{listening.sockets[0].getsockname()[1]}/mqtt"
        server = Server("mqtt://127.0.0.1:1", broker_for_visitors=at, login_for_visitors=Login("all", "secret"))
        trouble, hint = await PhonesDoor(server).trouble()
    assert (
        trouble == f"phones are locked out: cannot trust the certificate of the broker at {at}: self-signed certificate"
    )
    assert "SSL_CERT_FILE" in hint


async def test_the_door_says_which_half_of_a_phones_talk_does_not_get_through(guarded, monkeypatch):
    monkeypatch.setattr("phalanx.io.phones.ARRIVE_S", 0.5)
    url = parse_broker_url(guarded.tcp, Login("gateway", "secret"))
    for name, (_, lost) in PHONES.items():
        login = Login(name, "secret")
        at = RunningBroker("external", url, url, guarded.ws, 5, login)
        server = a_server(at, login_for_visitors=login)
        door = PhonesDoor(server)
        async with server:
            await server.wait_connected(10)
            trouble, hint = await door.trouble()
        assert trouble == (lost and f"phones get into {guarded.ws}, but {lost}"), name
        assert ("access control" in hint) == bool(lost)


async def test_while_more_comes_than_can_be_read_no_access_control_is_blamed(tmp_path, monkeypatch):
    monkeypatch.setattr("phalanx.io.phones.ARRIVE_S", 0.3)
    tcp, ws = free_port(), free_port()
    with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
        start()
        server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
        async with server:
            await server.wait_connected(10)
            heard = asyncio.Event()

            async def drowned(*_):
                server._link.overruns += 1
                heard.set()

            server._link._on_message = drowned  # as if it were dropped among others
            trouble, hint = await PhonesDoor(server).trouble()
            assert heard.is_set()
    assert trouble.startswith("whether phones get through is not known")
    assert "floods" in hint


@pytest.mark.parametrize(
    ("host", "said"), [("nowhere.invalid", "there is no nowhere.invalid"), ("127.0.0.1", "nothing")]
)
async def test_a_door_that_is_not_there_is_told_as_that(host, said):
    server = Server(f"mqtt://127.0.0.1:{free_port()}", broker_for_visitors=f"ws://{host}:{free_port()}/mqtt")
    trouble, hint = await PhonesDoor(server).trouble()
    assert trouble.startswith(said)
    assert hint == "--broker-ws"


async def test_who_is_out_of_files_does_not_say_that_nothing_listens(monkeypatch):
    async def out_of_files(*_, **__):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(asyncio, "open_connection", out_of_files)
    server = Server("mqtt://127.0.0.1:1", broker_for_visitors="ws://127.0.0.1:1/mqtt")
    assert await PhonesDoor(server).trouble() == (
        "whether phones get in is not known: too many open files",
        "ulimit -n",
    )


def test_only_what_it_says_itself_is_not_told():
    door = PhonesDoor(Server("mqtt://127.0.0.1:1"))
    door._knocker = "me"
    assert door.is_knocking(Request(NUMBER, "me", {}))
    assert door.is_knocking(Command(COMMAND, "me"))
    for said in (Request(NUMBER, "you", {}), Request(0, "me", {}), Command(COMMAND, "you"), Command(COMMAND, {})):
        assert not door.is_knocking(said)


async def test_up_tells_of_an_access_control_and_that_it_was_mended_as_soon_as_the_broker_is_back(guarded):
    with a_gateway(*guarded.words("writes")) as (up, ready):
        lost = f"phones get into {guarded.ws}, but {PHONES['writes'][1]}"
        await eventually(lambda: up.err)  # another pipe than its events
        (line,) = up.err
        assert lost in line
        assert "hint: see its access control: below /qrkey/+/ phones write" in line

        def state():
            address, token = ready["operator_url"].split("/#token=")
            asking = urllib.request.Request(f"{address}/api/state", headers={"Authorization": f"Bearer {token}"})
            return json.load(urllib.request.urlopen(asking))

        assert state()["broker"]["phones"] == lost
        guarded.let({"writes": PHONES["all"]})
        guarded.kill()
        guarded.start()
        await eventually(lambda: any("phones get in again" in line for line in up.err), 12)
        now = state()
        assert now["broker"]["phones"] == ""
        assert (now["counters"]["commands"], now["counters"]["requests"], now["visitors"]) == (0, 0, [])
        assert not up.events("command")


def test_an_echo_and_the_doctor_tell_of_it_too(guarded, monkeypatch):
    monkeypatch.setattr("phalanx.io.phones.ARRIVE_S", 0.5)  # the doctor's, who is in this process
    with child("link", "serve", "--events", *guarded.words("reads")) as echo:
        echo.wait_for("ready")
        until_s = time.monotonic() + 10
        while not echo.err and time.monotonic() < until_s:  # another pipe than its events
            time.sleep(0.02)
        (line,) = echo.err
        assert PHONES["reads"][1] in line
    for name, code in (("reads", 1), ("all", 0)):
        done = called("doctor", *guarded.words(name))
        assert done.returncode == code, done.stdout
        (told,) = [line for line in done.stdout.splitlines() if "broker, for phones" in line]
        assert (PHONES["reads"][1] in told) == bool(code)
    assert called("doctor", "--root", "/elsewhere", *guarded.words("all")).returncode == 1
