"""mosquitto as a supervised child: started with a configuration of ours, started again when it dies."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import hashlib
import os
import pwd
import shutil
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

from phalanx.errors import Unavailable
from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl
from .children import a_child, answer, kept
from .guarding import guarded
from .heard import Heard
from .listeners import READ, WRITE, Listeners
from .ports import LOOPBACK, PortTaken
from .private_file import private_folder
from .visitor_packets import MAX_KEEPALIVE_S

# Our own packets are small, an older page's list the largest; one of these holds up a phone's websocket for seconds.
EMBEDDED_PACKET_BYTES = 512 * 1024
# The last word, of the system: then nobody is served, and the watchdog starts it again. The guard leaves nothing to
# fill. mosquitto's own limit counts what it has given back: 56 bytes for each property of MQTT 5, 168 for each CONNECT.
MEMORY_BYTES = 256 * 1024 * 1024
QUEUED_MESSAGES = 500  # a thousand robots' list is 167 parts, twice in an overlap
ROUNDS = 101
CONFIG = "mosquitto.conf"
SOCKET = "run/visitors"
PROBE_BYTES = 64 * 1024
START_TIMEOUT_S = 20.0  # one that fails ends by itself; amqtt takes a second of processor time


def find_mosquitto() -> str | None:
    """Path of the mosquitto program; Debian puts it where only root's PATH looks."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def configuration(at: Listeners, folder: Path) -> str:
    """mosquitto.conf: the gateway with its login on one listener, visitors by way of the guard on another."""
    return "\n".join(
        (
            "# written by phalanx",
            "per_listener_settings true",
            "persistence false",
            "retain_available false",
            "sys_interval 0",
            f"max_packet_size {EMBEDDED_PACKET_BYTES}",
            f"max_queued_messages {QUEUED_MESSAGES}",
            "max_inflight_messages 1",
            f"max_keepalive {MAX_KEEPALIVE_S}",
            "set_tcp_nodelay true",
            "user root",  # where it cannot be another's: in a container without rights, say
            "log_dest stderr",
            "log_type error",
            "connection_messages false",
            f"listener {at.gateway_port} {LOOPBACK}",
            "allow_anonymous false",
            f"password_file {folder / 'gateway.password'}",
            f"# visitors come to the guard, at {at.visitors_port} and {at.ws_port}",
            f"listener 0 {folder / SOCKET}",
            "allow_anonymous true",
            f"acl_file {folder / 'visitors.acl'}",
            "max_qos 0",
            "max_topic_alias 0",
            "",
        )
    )


def visitors_acl(root: str) -> str:
    """What visitors may do, as mosquitto reads it."""
    may = [("write", sub) for sub in WRITE] + [("read", sub) for sub in READ]
    # A pattern is for everybody; the published page says an empty name, and is not anonymous therefore.
    return "".join(f"pattern {word} {root}/+/{sub}\n" for word, sub in may)


def password_line(login: Login) -> str:
    """A line of mosquitto's password file. Source: mosquitto_passwd(1), PBKDF2 with SHA-512."""
    salt = os.urandom(12)
    # The password is random: a search is hopeless whatever the rounds.
    hashed = hashlib.pbkdf2_hmac("sha512", login.password.encode(), salt, ROUNDS)
    told = "$".join(("", "7", str(ROUNDS), base64.b64encode(salt).decode(), base64.b64encode(hashed).decode()))
    return f"{login.username}:{told}\n"


def _whose() -> str | None:
    """As whom to run it. mosquitto gives up root by itself, but that would undo what `die_with_parent` asks for."""
    if os.geteuid() != 0:
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return "mosquitto" if "mosquitto" in names else "nobody"


@contextlib.asynccontextmanager
async def mosquitto(at: Listeners) -> AsyncIterator[Heard]:
    """Run mosquitto; yield what the gateway shall tell the guard before it. Raises: Unavailable: it does not start."""
    program = find_mosquitto()
    if program is None:
        raise Unavailable("mosquitto is not installed", "apt-get install mosquitto, or --broker amqtt")
    with private_folder() as folder:
        user = _write(folder, at)
        child = partial(a_child, program, "-c", str(folder / CONFIG), user=user, most_bytes=MEMORY_BYTES)
        begins = partial(until_it_serves, "mosquitto", at.gateway)
        async with (
            kept("mosquitto", child, partial(serves, at.gateway), begins),
            guarded(at, folder / SOCKET, folder) as heard,
        ):
            yield heard


def _write(folder: Path, at: Listeners) -> str | None:
    """The broker's files, for the user it runs as and nobody else; that user, None for our own."""
    files = {
        CONFIG: configuration(at, folder),
        "visitors.acl": visitors_acl(at.root),
        "gateway.password": password_line(at.login),
    }
    for name, text in files.items():
        (folder / name).touch(mode=0o600)
        (folder / name).write_text(text)
    (folder / SOCKET).parent.mkdir(mode=0o700)
    if user := _whose():
        try:
            for name in (*files, "run"):
                shutil.chown(folder / name, user)
        except OSError:
            return None
        folder.chmod(0o711)  # it may pass
    return user


async def serves(url: BrokerUrl) -> bool | None:
    """Return whether the broker takes a connection and passes on a long message in time; None if we do not know."""
    assert url.login is not None
    topic = _string(f"phalanx/probe/{os.urandom(8).hex()}")
    hello = _string("MQTT") + b"\x04\xc2\x00\x0a" + b"".join(map(_string, ("", url.login.username, url.login.password)))
    message = _packet(0x30, topic + bytes(PROBE_BYTES))
    said = _packet(0x10, hello) + _packet(0x82, b"\x00\x01" + topic + b"\x00") + message
    # CONNACK, SUBACK and the message itself.
    heard = await answer((url.host, url.port), said, 4 + 5 + len(message))
    return None if heard is None else heard.endswith(message)


def _string(text: str) -> bytes:
    return len(text).to_bytes(2, "big") + text.encode()


def _packet(kind: int, body: bytes) -> bytes:
    head, left = bytearray([kind]), len(body)
    while left >= 128:
        head.append(left & 127 | 128)
        left >>= 7
    return bytes((*head, left)) + body


async def until_it_serves(name: str, url: BrokerUrl, process: asyncio.subprocess.Process) -> None:
    """Wait until it serves: one that listens may yet end. Raises: PortTaken. Unavailable: it does not start."""
    deadline, does = asyncio.get_running_loop().time() + START_TIMEOUT_S, None
    while process.returncode is None and asyncio.get_running_loop().time() < deadline:
        if does := await serves(url):
            return
        await asyncio.sleep(0.02)
    if does is None and process.returncode is None:
        return  # we had no file left to ask it; who watches it asks on
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    assert process.stderr is not None
    said = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
    failure = PortTaken if said and said[-1].endswith(os.strerror(errno.EADDRINUSE)) else Unavailable
    raise failure(f"{name} does not start: {said[-1] if said else 'no reason given'}", "phalanx doctor")
