"""MQTT over a websocket: aiohttp speaks to the broker, and passes the bytes to paho over a pair of sockets.

paho's own websocket copies the whole frame for each piece that it reads, so a frame of 1 MB with many small packets
blocks it for minutes. It also answers pings without a mask, for which brokers close the connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import AsyncIterator

import aiohttp
import aiomqtt

from .broker_packets import MAX_PACKET_BYTES
from .broker_url import BrokerUrl
from .packets import READ_BYTES, READ_FOR_S

MAX_FRAME_BYTES = 8 * MAX_PACKET_BYTES  # a packet that is too long is skipped up to this size
CLOSE_S = 1.0


@contextlib.asynccontextmanager
async def websocket_as_socket(broker: BrokerUrl) -> AsyncIterator[socket.socket]:
    """Yield a socket that is connected to the broker. Raises: MqttError, OSError: there is no websocket."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    async with contextlib.AsyncExitStack() as stack:
        stack.callback(ours.close)
        http = await stack.enter_async_context(aiohttp.ClientSession())
        try:
            there = await http.ws_connect(
                str(broker),
                protocols=("mqtt",),
                max_msg_size=MAX_FRAME_BYTES,
                autoping=False,
                ssl=ssl.create_default_context() if broker.tls else True,
            )
        except (aiohttp.ClientResponseError, aiohttp.ServerDisconnectedError) as error:
            raise aiomqtt.MqttError("no websocket there") from error
        except aiohttp.ClientError as error:
            raise aiomqtt.MqttError(str(error)) from error
        stack.push_async_callback(end_websocket, there)
        carriers = [asyncio.create_task(carry) for carry in (_inward(there, ours), _outward(ours, there))]
        try:
            yield theirs
        finally:
            for carrier in carriers:
                carrier.cancel()


async def end_websocket(there: aiohttp.ClientWebSocketResponse) -> None:
    """Close a websocket within CLOSE_S, whatever the peer does."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(CLOSE_S):  # aiohttp's own timeout restarts with each message
            await there.close()


async def _inward(there: aiohttp.ClientWebSocketResponse, ours: socket.socket) -> None:
    """Copy received bytes until the websocket is closed; yield to other tasks regularly."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + READ_FOR_S
    with contextlib.suppress(OSError, aiohttp.ClientError):
        async for message in there:
            match message.type:
                case aiohttp.WSMsgType.BINARY:
                    await loop.sock_sendall(ours, message.data)
                case aiohttp.WSMsgType.PING:
                    await there.pong(message.data)
                case aiohttp.WSMsgType.PONG:
                    pass
                case _:
                    break
            if loop.time() > until_s:
                await asyncio.sleep(0)
                until_s = loop.time() + READ_FOR_S
        ours.shutdown(socket.SHUT_RDWR)


async def _outward(ours: socket.socket, there: aiohttp.ClientWebSocketResponse) -> None:
    with contextlib.suppress(OSError, aiohttp.ClientError):
        while data := await asyncio.get_running_loop().sock_recv(ours, READ_BYTES):
            await there.send_bytes(data)
