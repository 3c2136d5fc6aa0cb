"""A stranger's raw MQTT connection, and the process of a mosquitto."""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
from pathlib import Path
from typing import Self


def with_length(kind: int, body: bytes) -> bytes:
    """An MQTT packet."""
    return bytes([kind]) + varint(len(body)) + body


def varint(number: int) -> bytes:
    said = bytearray()
    while True:
        number, low = divmod(number, 128)
        said.append(low | (128 if number else 0))
        if not number:
            return bytes(said)


def connect(version: int, name: bytes = b"stranger", *, clean: bool = True, keepalive_s: int = 60) -> bytes:
    head = b"\x00\x04MQTT" + bytes([version, 2 if clean else 0]) + keepalive_s.to_bytes(2, "big")
    return with_length(0x10, head + (b"\x00" if version == 5 else b"") + len(name).to_bytes(2, "big") + name)


class Stranger:
    """A raw MQTT connection, by TCP on loopback."""

    def __init__(self, port: int, version: int = 5, **how) -> None:
        self._where = ("127.0.0.1", port)
        self._hello = connect(version, **how)

    def publish(self, topic: str, payload: bytes, properties: bytes | None = None) -> None:
        """At QoS 0; `properties` only by MQTT 5, and there always."""
        head = len(topic).to_bytes(2, "big") + topic.encode()
        head += b"" if properties is None else varint(len(properties)) + properties
        self.socket.sendall(with_length(0x30, head + payload))

    def subscribe(self, *filters: str, qos: int = 0) -> None:
        """By MQTT 3.1.1."""
        body = b"".join(len(f).to_bytes(2, "big") + f.encode() + bytes([qos]) for f in filters)
        self.socket.sendall(with_length(0x82, b"\x00\x01" + body))
        assert self.socket.recv(64)[:1] == b"\x90"

    def __enter__(self) -> Self:
        self.socket = socket.create_connection(self._where, 5)
        self.socket.settimeout(5)
        self.socket.sendall(self._hello)
        answer = self.socket.recv(64)
        assert answer[:1] == b"\x20"
        assert answer[3] == 0, "refused"
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    # A broker may be in this very process.
    async def __aenter__(self) -> Self:
        return await asyncio.to_thread(self.__enter__)

    async def __aexit__(self, *_: object) -> None:
        self.socket.close()


def the_process(broker_port: int) -> int:
    """Of our mosquitto that listens there."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            program, *words = path.read_text().split("\0")
            if (path.parent / "ns/net").readlink() != Path("/proc/self/ns/net").readlink():
                continue  # somebody's in a network of its own, whose ports are others
            if program.endswith("mosquitto") and re.search(rf"\b{broker_port}\b", Path(words[1]).read_text()):
                return int(path.parent.name)
    raise AssertionError("no such mosquitto")
