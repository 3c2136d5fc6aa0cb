"""One end of a websocket: bytes of the other end in, what they carry out. Without a socket.

No extension is agreed on, so nothing can be small on the wire and large here; nothing is kept but a piece of a header.
Source: RFC 6455.
"""

from __future__ import annotations

import base64
import hashlib

from phalanx.errors import PeerError

LONGEST_REQUEST = 8192
FRAMES_AT_ONCE = 16  # others wait meanwhile
LONGEST_CONTROL = 125
BINARY, CLOSE, PING, PONG = 2, 8, 9, 10
UNMASKED = bytes(4)
_MAGIC = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


class NoWebsocketError(PeerError):
    """Not a websocket that carries MQTT; `answer` is what HTTP says to that, or b""."""

    reason = "no_websocket"

    def __init__(self, why: str, answer: bytes = b"") -> None:
        super().__init__(why)
        self.answer = answer


class Websocket:
    """A server's end, or a client's that was agreed to. After each `read`, send `replies`, and see `closed`."""

    def __init__(self, *, server: bool = True) -> None:
        self.replies = b""
        self.frames = 0  # that the last `read` began
        self.closed = False
        self._server = server
        self._is_open = not server
        self._head = bytearray()  # of a request or a frame, as far as it has come
        self._unread = b""
        self._left = self._turn = 0  # bytes of the frame to come; which byte of the mask is next
        self._mask = b""
        self._opcode = BINARY
        self._control = bytearray()

    @property
    def has_more(self) -> bool:
        """Whether something that came is not read yet: frames above `FRAMES_AT_ONCE`."""
        return bool(self._unread) and not self.closed

    @property
    def unread_bytes(self) -> int:
        """How much that is."""
        return len(self._unread)

    def read(self, data: bytes = b"") -> bytes:
        """Return what is carried by `data`, after what was left. Raises: NoWebsocketError: it is to be hung up on."""
        data, self._unread, self.frames = self._unread + data, b"", 0
        if not self._is_open:
            self._head += data
            end = self._head.find(b"\r\n\r\n")
            if end < 0:
                if len(self._head) > LONGEST_REQUEST:
                    raise NoWebsocketError("an endless request")
                return b""
            self.replies += _agree(bytes(self._head[:end]))
            self._is_open = True
            data = bytes(self._head[end + 4 :])
            self._head.clear()
        carried = bytearray()
        at = 0
        while at < len(data) and not self.closed:
            if not self._left:
                if self.frames == FRAMES_AT_ONCE:
                    self._unread = data[at:]
                    break
                self.frames += 1
                at = self._begin_frame(data, at)
                if not self._mask:
                    break
            piece = data[at : at + self._left]
            at += len(piece)
            self._left -= len(piece)
            self._take(self._unmasked(piece), carried)
        return bytes(carried)

    def _begin_frame(self, data: bytes, at: int) -> int:
        """Read a frame's header from `at` on, as far as it is there; where what follows begins."""
        self._mask = b""
        while at < len(data) and len(self._head) < self._head_bytes():
            self._head.append(data[at])
            at += 1
        size = self._head_bytes()
        if len(self._head) < size:
            return at
        self._opcode = self._head[0] & 15 or BINARY  # 0 goes on with what was begun, and text is refused
        short = self._head[1] & 127
        self._left = short if short < 126 else int.from_bytes(self._head[2 : size - 4 * self._server], "big")
        if self._head[0] & 0x70 or self._opcode not in (BINARY, CLOSE, PING, PONG):
            raise NoWebsocketError("a frame that nobody agreed on")
        if self._opcode >= CLOSE and self._left > LONGEST_CONTROL:
            raise NoWebsocketError("a long control frame")
        self._mask, self._turn = bytes(self._head[-4:]) if self._server else UNMASKED, 0
        self._head.clear()
        if not self._left:
            self._take(b"", bytearray())
            self._mask = b"" if at == len(data) else self._mask
        return at

    def _head_bytes(self) -> int:
        if len(self._head) < 2:
            return 2
        if bool(self._head[1] & 128) != self._server:
            raise NoWebsocketError("visitors mask their frames, and nobody else")
        return 2 + 4 * self._server + {126: 2, 127: 8}.get(self._head[1] & 127, 0)

    def _unmasked(self, piece: bytes) -> bytes:
        if self._mask == UNMASKED:
            return piece
        mask = self._mask[self._turn :] + self._mask[: self._turn]
        self._turn = (self._turn + len(piece)) % 4
        key = (mask * (len(piece) // 4 + 1))[: len(piece)]
        return (int.from_bytes(piece, "big") ^ int.from_bytes(key, "big")).to_bytes(len(piece), "big")

    def _take(self, plain: bytes, carried: bytearray) -> None:
        if self._opcode < CLOSE:
            carried += plain
            return
        self._control += plain
        if self._left:
            return
        if self._opcode == CLOSE:
            self.closed = True
            self.replies += self._control_frame(CLOSE)
        if self._opcode == PING:
            # The last of many may be answered alone (§5.5.3): who asks and does not read leaves us nothing to keep.
            self.replies = (self.replies if self._server else b"") + self._control_frame(PONG)
        self._control.clear()
        self._opcode = BINARY

    def _control_frame(self, opcode: int) -> bytes:
        told = bytes(self._control) if opcode == PONG else b""
        head = frame_head(opcode, len(told))
        return head + told if self._server else bytes((head[0], head[1] | 128)) + UNMASKED + told


def frame_head(opcode: int, length: int) -> bytes:
    """What comes before `length` bytes to a visitor."""
    head = bytes([0x80 | opcode])
    if length < 126:
        return head + bytes([length])
    return head + (b"\x7e" + length.to_bytes(2, "big") if length < 65536 else b"\x7f" + length.to_bytes(8, "big"))


def _agree(request: bytes) -> bytes:
    first, *lines = request.split(b"\r\n")
    told: dict[bytes, bytes] = {}
    for line in lines:
        name, _, value = line.partition(b":")
        told[name.strip().lower()] = value.strip()
    key = told.get(b"sec-websocket-key", b"")
    offered = [each.strip() for each in told.get(b"sec-websocket-protocol", b"").split(b",")]
    if not first.startswith(b"GET ") or told.get(b"upgrade", b"").lower() != b"websocket" or len(key) != 24:
        refusal = (
            b"HTTP/1.1 426 Upgrade Required\r\nUpgrade: websocket\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
        )
        raise NoWebsocketError("no websocket", refusal)
    accept = base64.b64encode(hashlib.sha1(key + _MAGIC, usedforsecurity=False).digest())
    protocol = next((each for each in offered if each in (b"mqtt", b"mqttv3.1")), b"")
    return b"".join(
        (
            b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n",
            b"Sec-WebSocket-Accept: " + accept + b"\r\n",
            b"Sec-WebSocket-Protocol: " + protocol + b"\r\n" if protocol else b"",
            b"\r\n",
        )
    )
