"""Robots of your own behind the link: python examples/ten_lines.py [BROKER]"""

import asyncio
import contextlib
import sys

from phalanx.errors import Unknown
from phalanx.gateway.vocabulary import parse_move_raw
from phalanx.link import Command, Request, Server

server = Server(sys.argv[1] if len(sys.argv) > 1 else "mqtt://127.0.0.1:1883")
wheels = {"ROBOT-1": (0, 0), "ROBOT-2": (0, 0)}


@server.on_command("move_raw")
async def drive(command: Command) -> None:
    """Turn the wheels of one robot, and tell every visitor. A refusal is counted, and nobody is told why."""
    if command.address not in wheels:
        raise Unknown("no such robot")
    move = parse_move_raw(command.payload)  # authentic is not sensible: anybody with the code wrote it
    wheels[command.address] = (move.left_pct, move.right_pct)
    await server.notify({"driven": command.address, "wheels": wheels[command.address]})


@server.on_request(0)
def robots(_: Request) -> list[dict[str, object]]:
    """Answer whoever asks which robots there are."""
    return [{"address": address, "wheels": pair} for address, pair in wheels.items()]


async def main() -> None:
    """Serve until Ctrl-C."""
    async with server:
        await server.wait_connected()
        print(server.qr().for_page("phalanx:"), flush=True)
        await server.run()


with contextlib.suppress(KeyboardInterrupt):
    asyncio.run(main())
