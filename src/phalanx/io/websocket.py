"""The client's end of a websocket: bytes of the other end in, what they carry out. Without a socket.

No extension is agreed on, so nothing can be small on the wire and large here; nothing is kept but a piece of a header.
Source: RFC 6455.
"""

from __future__ import annotations

from phalanx.errors import PeerError

FRAMES_AT_ONCE = 16  # others wait meanwhile
LONGEST_CONTROL = 125
BINARY, CLOSE, PING, PONG = 2, 8, 9, 10
UNMASKED = bytes(4)


class NoWebsocketError(PeerError):
    """Not a websocket that carries MQTT."""

    reason = "no_websocket"


class Websocket:
    """A client's end, after the handshake. After each `read`, send `replies`, and see `closed`."""

    def __init__(self) -> None:
        self.replies = b""
        self.closed = False
        self._head = bytearray()  # of a frame, as far as it has come
        self._unread = b""
        self._left = 0  # bytes of the frame to come
        self._opcode = BINARY
        self._control = bytearray()

    @property
    def has_more(self) -> bool:
        """Whether something that came is not read yet: frames above `FRAMES_AT_ONCE`."""
        return bool(self._unread) and not self.closed

    def read(self, data: bytes = b"") -> bytes:
        """Return what is carried by `data`, after what was left. Raises: NoWebsocketError: it is to be hung up on."""
        data, self._unread = self._unread + data, b""
        carried = bytearray()
        at = frames = 0
        while at < len(data) and not self.closed:
            if not self._left:
                if frames == FRAMES_AT_ONCE:
                    self._unread = data[at:]
                    break
                frames += 1
                at, begun = self._begin_frame(data, at)
                if not begun:
                    break
            piece = data[at : at + self._left]
            at += len(piece)
            self._left -= len(piece)
            self._take(piece, carried)
        return bytes(carried)

    def _begin_frame(self, data: bytes, at: int) -> tuple[int, bool]:
        """Read a frame's header from `at` on; return where what follows begins, and whether all of it is there."""
        while at < len(data) and len(self._head) < self._head_bytes():
            self._head.append(data[at])
            at += 1
        if len(self._head) < self._head_bytes():
            return at, False
        self._opcode = self._head[0] & 15 or BINARY  # 0 goes on with what was begun, and text is refused
        short = self._head[1] & 127
        self._left = short if short < 126 else int.from_bytes(self._head[2:], "big")
        if self._head[0] & 0x70 or self._opcode not in (BINARY, CLOSE, PING, PONG):
            raise NoWebsocketError("a frame that nobody agreed on")
        if self._opcode >= CLOSE and self._left > LONGEST_CONTROL:
            raise NoWebsocketError("a long control frame")
        self._head.clear()
        return at, True

    def _head_bytes(self) -> int:
        if len(self._head) < 2:
            return 2
        if self._head[1] & 128:
            raise NoWebsocketError("clients mask their frames, and nobody else")
        return 2 + {126: 2, 127: 8}.get(self._head[1] & 127, 0)

    def _take(self, piece: bytes, carried: bytearray) -> None:
        if self._opcode < CLOSE:
            carried += piece
            return
        self._control += piece
        if self._left:
            return
        if self._opcode == CLOSE:
            self.closed = True
            self.replies += self._control_frame(CLOSE)
        if self._opcode == PING:
            # The last of many may be answered alone (§5.5.3): who asks and does not read leaves us nothing to keep.
            self.replies = self._control_frame(PONG)
        self._control.clear()

    def _control_frame(self, opcode: int) -> bytes:
        told = bytes(self._control) if opcode == PONG else b""
        return bytes((0x80 | opcode, len(told) | 128)) + UNMASKED + told


def frame_head(opcode: int, length: int) -> bytes:
    """Return what comes before `length` bytes of a server's frame."""
    head = bytes([0x80 | opcode])
    if length < 126:
        return head + bytes([length])
    return head + (b"\x7e" + length.to_bytes(2, "big") if length < 65536 else b"\x7f" + length.to_bytes(8, "big"))
