"""State of the projector's page: the code, the visitors, a caption. It has no operator's functions.

Its token gives access to this page only. Everybody who sees the page can join, as with the code on the screen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.crypto.keys import hkdf_sha256
from phalanx.errors import UsageError

from .operator_desk import qr_svg
from .session_link import now

if TYPE_CHECKING:
    from .running import Running

TOKEN_BYTES = 16
SSID_BYTES = 32
PASSWORD_BYTES = range(8, 64)  # of WPA
# https://github.com/zxing/zxing/wiki/Barcode-Contents; segno's own helper leaves the comma as it is.
ESCAPED = {ord(each): f"\\{each}" for each in '\\;,:"'}


@dataclass(frozen=True, slots=True)
class Wifi:
    """A Wi-Fi network that visitors' phones join first. Raises: UsageError: an invalid name or password."""

    ssid: str
    password: str = field(repr=False, default="")  # "" for an open network

    def __post_init__(self) -> None:
        if not 0 < len(self.ssid.encode()) <= SSID_BYTES:
            raise UsageError("--wifi: a network's name has 1 to 32 bytes", "use the name as phones list it")
        if self.password and len(self.password.encode()) not in PASSWORD_BYTES:
            raise UsageError("--wifi-password-file: a password has 8 to 63 bytes", "check the first line of the file")

    @property
    def code(self) -> str:
        """Return the text of the QR code to join the network."""
        security, password = ("T:WPA;", f"P:{self.password.translate(ESCAPED)};") if self.password else ("", "")
        return f"WIFI:{security}S:{self.ssid.translate(ESCAPED)};{password};"


def projector_token(static: X25519PrivateKey) -> str:
    """Return the token of the projector's page, derived from the gateway's key: a restart keeps it."""
    return hkdf_sha256(static.private_bytes_raw(), b"phalanx projector", TOKEN_BYTES).hex()


class Projector:
    """The state of the page.

    Attributes:
        caption: a text in large letters; "" for none.
    """

    def __init__(self, running: Running, token: str, wifi: Wifi | None, *, unreachable: str = "") -> None:
        self.token, self.caption = token, ""
        self._running, self._unreachable = running, unreachable
        self._wifi = {"ssid": wifi.ssid, "svg": qr_svg(wifi.code)} if wifi else None

    def state(self) -> dict[str, Any]:
        """Return the data of the page."""
        running = self._running
        desk, robots = running.desk, running.gateway.swarm.robots()
        names = {robot.address: robot.name for robot in robots}
        known = desk.visitors()
        here = [each for each in known if each["present"] and not each["waiting"] and each["role"] != "operate"]
        return {
            "page_url": running.page_url,
            "qr_svg": desk.qr_svg(running.qr_url),
            "room": running.link.server.door.room,
            "watch_only": running.gateway.missions is not None,
            "visitors": [{"name": each["name"], "robot": names.get(each["robot"], "")} for each in here],
            "queue": self._queue(here, [each["visitor"] for each in known if each["robot"]], names),
            "caption": self.caption,
            "held": running.gateway.brakes.held,
            "wifi": self._wifi,
            "unreachable": self._unreachable,
        }

    def _queue(self, here: list[dict[str, Any]], drivers: list[int], names: dict[str, str]) -> list[dict[str, Any]]:
        """Return the queue in order, each with the robot whose turn ends by then; "" if none will be free."""
        assignment, now_ms = self._running.link.server.assignment, now().ms
        turns = sorted((assignment.left_ms(each, now_ms), assignment.robot_of(each) or "") for each in drivers)
        queue = []
        for each in sorted((each for each in here if each["place"]), key=lambda each: each["place"]):
            left_ms, robot = turns[each["place"] - 1] if each["place"] <= len(turns) else (0, "")
            queue.append({"name": each["name"], "robot": names.get(robot, ""), "left_s": math.ceil(left_ms / 1000)})
        return queue
