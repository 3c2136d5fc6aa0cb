"""mosquitto as a supervised child process, restarted when it ends; for trying out a broker.

Anybody may connect and publish there, as on any broker without access control.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import pwd
import shutil
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

from phalanx.errors import Unavailable

from .broker_url import BrokerUrl
from .children import answer, run_child, supervise_child
from .ports import EVERYWHERE, LOOPBACK, PortTaken, is_free
from .private_file import private_folder

# Largest packet: an older page's list of robots. A packet of this size takes a phone's websocket seconds.
PACKET_BYTES = 512 * 1024
MEMORY_BYTES = 256 * 1024 * 1024  # limit of mosquitto's memory: beyond it, it ends and is restarted
QUEUED_MESSAGES = 500  # the list of a thousand robots has 167 parts, sent twice in an overlap
MAX_KEEPALIVE_S = 120
CONFIG = "mosquitto.conf"
PROBE_BYTES = 64 * 1024
TAKEN = (os.strerror(errno.EADDRINUSE), "Unable to create websockets listener")
START_TIMEOUT_S = 20.0


def find_mosquitto() -> str | None:
    """Return the path of the mosquitto program; on Debian it is in a folder that only root has in PATH."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def configuration(port: int, ws_host: str, ws_port: int) -> str:
    """Return the text of mosquitto.conf: TCP on loopback, and websockets on `ws_host`."""
    return "\n".join(
        (
            "# written by phalanx",
            "allow_anonymous true",
            "persistence false",
            "retain_available false",
            "sys_interval 0",
            f"max_packet_size {PACKET_BYTES}",
            f"max_queued_messages {QUEUED_MESSAGES}",
            "max_inflight_messages 1",
            f"max_keepalive {MAX_KEEPALIVE_S}",
            "set_tcp_nodelay true",
            "user root",  # if it cannot change its user, as in an unprivileged container
            "log_dest stderr",
            "log_type error",
            "connection_messages false",
            f"listener {port} {LOOPBACK}",
            "max_qos 0",
            f"listener {ws_port}{'' if ws_host in EVERYWHERE else f' {ws_host}'}",
            "protocol websockets",
            # Otherwise mosquitto 2.0.11 listens for websockets on every address.
            *(() if ":" in ws_host else ("socket_domain ipv4",)),
            "max_qos 0",
            "",
        )
    )


def _user() -> str | None:
    """Return the user to run it as. If it dropped root by itself, the setting of `die_with_parent` would be lost."""
    if os.geteuid() != 0:
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return "mosquitto" if "mosquitto" in names else "nobody"


@contextlib.asynccontextmanager
async def mosquitto(port: int, ws_host: str, ws_port: int) -> AsyncIterator[None]:
    """Run mosquitto. Raises: PortTaken. Unavailable: it is not installed, or does not start."""
    program = find_mosquitto()
    if program is None:
        raise Unavailable("mosquitto is not installed", "install it (apt-get install mosquitto), or use --broker URL")
    for each, host in ((port, LOOPBACK), (ws_port, ws_host)):
        if not is_free(each, host):
            raise PortTaken(f"cannot listen on {host} port {each}: another program uses it", "run phalanx doctor")
    url = BrokerUrl("mqtt", LOOPBACK, port)
    with private_folder() as folder:
        user = _write(folder, configuration(port, ws_host, ws_port))
        child = partial(run_child, program, "-c", str(folder / CONFIG), user=user, most_bytes=MEMORY_BYTES)
        async with supervise_child("mosquitto", child, partial(serves, url), partial(_until_it_serves, url)):
            yield


def _write(folder: Path, text: str) -> str | None:
    """Write its configuration; return the user to run it as, None for the current one."""
    (folder / CONFIG).touch(mode=0o600)
    (folder / CONFIG).write_text(text)
    if user := _user():
        try:
            shutil.chown(folder / CONFIG, user)
        except OSError:
            return None
        folder.chmod(0o711)  # that user may enter, but not list it
    return user


async def serves(url: BrokerUrl) -> bool | None:
    """Return whether the broker delivers a long message in time; None if that cannot be tested now."""
    topic = _string(f"phalanx/probe/{os.urandom(8).hex()}")
    hello = _string("MQTT") + b"\x04\x02\x00\x0a" + _string("")
    message = _packet(0x30, topic + bytes(PROBE_BYTES))
    sent = _packet(0x10, hello) + _packet(0x82, b"\x00\x01" + topic + b"\x00") + message
    # The answer: CONNACK, SUBACK and the message itself.
    received = await answer(url.host, url.port, sent, 4 + 5 + len(message))
    return None if received is None else received.endswith(message)


def _string(text: str) -> bytes:
    return len(text).to_bytes(2, "big") + text.encode()


def _packet(kind: int, body: bytes) -> bytes:
    head, left = bytearray([kind]), len(body)
    while left >= 128:
        head.append(left & 127 | 128)
        left >>= 7
    return bytes((*head, left)) + body


def _listens(pid: int, port: int) -> bool:
    """Return whether this process owns the socket that listens at a port, as another broker may answer there.

    Returns true if the system does not tell.
    """
    try:
        rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        ours = {f"socket:[{row[9]}]" for row in rows if row[3] == "0A" and int(row[1].partition(":")[2], 16) == port}
        return any(str(each.readlink()) in ours for each in Path(f"/proc/{pid}/fd").iterdir())
    except FileNotFoundError:
        return False  # it has ended, or is just opening or closing a file: the caller tries again
    except OSError:
        return True


async def _until_it_serves(url: BrokerUrl, process: asyncio.subprocess.Process) -> None:
    """Wait until it delivers messages. Raises: PortTaken. Unavailable: it does not start."""
    deadline, does = asyncio.get_running_loop().time() + START_TIMEOUT_S, None
    while process.returncode is None and asyncio.get_running_loop().time() < deadline:
        if (does := await serves(url)) and _listens(process.pid, url.port):
            return
        await asyncio.sleep(0.02)
    if does is None and process.returncode is None:
        return  # no file descriptor left for a test: the supervisor tests it again
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    assert process.stderr is not None
    lines = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
    why = lines[-1] if lines else "no reason given"
    failure = PortTaken if any(each in why for each in TAKEN) else Unavailable
    raise failure(f"mosquitto does not start: {why}", "run phalanx doctor")
