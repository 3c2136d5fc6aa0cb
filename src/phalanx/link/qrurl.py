"""QR code links of mode qrkey: phalanx puts the pin into the fragment, the published packages put it into the query.

Source: docs/spec/link.md.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from phalanx.config import LinkConfig
from phalanx.errors import UsageError

from .pin import Pin

VERSION = "1"
DEFAULT_ROOT = "/qrkey"
DEFAULT_MQTT = 5
MQTT = {"4": 4, "5": 5}
LOGIN_LONGEST = 128  # bytes of UTF-8
_BROKER = re.compile(
    r"wss?://([0-9a-z._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?(/[^?#\s]*)?",  # no user:password@, which a QR code would show
    re.IGNORECASE | re.ASCII,
)


class BadQrUrl(UsageError):
    """Not a valid link of a swarm's QR code. The message never contains the link, because the pin is in it."""

    def __init__(self, what: str) -> None:
        super().__init__(f"not a swarm's link: {what}", "copy the whole link, in quotes, from under the QR code")


@dataclass(frozen=True, slots=True)
class Login:
    """A broker's user name and password."""

    username: str
    password: str = field(repr=False)


@dataclass(frozen=True, slots=True)
class QrUrl:
    """Content of a QR code: all that a visitor needs to connect. Raises: BadQrUrl."""

    pin: Pin = field(repr=False)
    broker: str  # websocket URL of the broker
    root: str = DEFAULT_ROOT  # first part of every topic
    mqtt: int = DEFAULT_MQTT  # protocol version, 5 or 4 (3.1.1)
    login: Login | None = None  # visitors' login, if the broker requires one

    def __post_init__(self) -> None:
        if not _BROKER.fullmatch(self.broker):
            raise BadQrUrl("the broker is not a ws:// or wss:// URL")
        try:
            urlsplit(self.broker).port  # noqa: B018  # raises for a port out of range
        except ValueError:
            raise BadQrUrl("the broker's port is not valid") from None
        if self.mqtt not in MQTT.values():
            raise BadQrUrl("the MQTT version is not 4 or 5")
        try:
            LinkConfig(root=self.root)
        except UsageError as error:
            raise BadQrUrl(str(error)) from None

    def for_page(self, page: str) -> str:
        """Return a link to the gateway's page: parameters in the fragment, which browsers do not send."""
        parameters = {"v": VERSION, "pin": self.pin.digits, "broker": self.broker}
        # Defaults are left out: every character makes the code finer and harder to scan.
        if self.root != DEFAULT_ROOT:
            parameters["root"] = self.root
        if self.mqtt != DEFAULT_MQTT:
            parameters["mqtt"] = str(self.mqtt)
        if self.login:
            parameters |= {"user": self.login.username, "password": self.login.password}
        return f"{page}#{urlencode(parameters, quote_via=quote, safe='')}"

    def for_foreign_page(self, frontend: str) -> str:
        """Return a link to a page of the published packages, whose form has neither a path nor a root.

        It has no login either. The published server writes one into the query, which the page's host can read, but
        the published hook (npm qrkey 0.4 to 0.12) ignores it and shows a login form.

        Source: the published packages.
        """
        broker = urlsplit(self.broker)
        tls = broker.scheme.lower() == "wss"
        parameters = {
            "use_qrkey": "true",
            "pin": self.pin.digits,
            "mqtt_host": broker.hostname or "",
            "mqtt_port": str(broker.port or (443 if tls else 80)),
            "mqtt_version": str(self.mqtt),
            "mqtt_use_ssl": str(tls),
        }
        return f"{frontend}?{urlencode(parameters, quote_via=quote)}"


def parse_qr_url(url: str, root: str = DEFAULT_ROOT) -> QrUrl:
    """Parse a scanned link; `root` is used for the published form, which has none. Raises: BadQrUrl, BadPin."""
    try:
        parts = urlsplit(url.strip())
        given = parse_qs(parts.fragment or parts.query, max_num_fields=32)
    except ValueError:
        raise BadQrUrl("not a URL") from None
    # With two values of one parameter, two programs could take different pins from one link.
    if any(len(values) > 1 for values in given.values()):
        raise BadQrUrl("duplicate parameter")
    parameters = {name: values[0] for name, values in given.items()}
    if "pin" not in parameters:
        raise BadQrUrl("no pin")
    if parts.fragment:
        if parameters.get("v") != VERSION:
            raise BadQrUrl("unknown version")
        return QrUrl(
            Pin(parameters["pin"]),
            parameters.get("broker", ""),
            parameters.get("root", DEFAULT_ROOT),
            MQTT.get(parameters.get("mqtt", "5"), 0),
            _login(parameters.get("user", ""), parameters.get("password", "")),
        )
    scheme = "wss" if parameters.get("mqtt_use_ssl", "False").lower() == "true" else "ws"
    broker = f"{scheme}://{parameters.get('mqtt_host', '')}:{parameters.get('mqtt_port', '')}/mqtt"
    login = _login(parameters.get("mqtt_username", ""), parameters.get("mqtt_password", ""))
    return QrUrl(Pin(parameters["pin"]), broker, root, MQTT.get(parameters.get("mqtt_version", "5"), 0), login)


def _login(username: str, password: str) -> Login | None:
    if password and not username:
        raise BadQrUrl("a password without a user name")
    if max(len(username.encode()), len(password.encode())) > LOGIN_LONGEST or not (username + password).isprintable():
        raise BadQrUrl("user name or password too long, or not printable")
    return Login(username, password) if username else None
