"""Robots of your own behind the link: python examples/ten_lines.py [BROKER]"""

import asyncio
import contextlib
import sys

from phalanx import link
from phalanx.gateway.vocabulary import parse_move_raw

server = link.Server(sys.argv[1] if len(sys.argv) > 1 else "mqtt://127.0.0.1:1883")
went = {"ROBOT-1": 0, "ROBOT-2": 0}  # how far each was driven ahead: percent, added up


@server.on_command("move_raw")
async def drive(command: link.Command) -> None:
    if command.address in went:  # authentic is not sensible: anybody with the code wrote it
        move = parse_move_raw(command.payload)  # wheels in percent, or BadPayload: counted and survived
        went[command.address] += (move.left_pct + move.right_pct) // 2
        await server.notify({"driven": command.address, "wheels": (move.left_pct, move.right_pct)})


@server.on_request(0)
def robots(_: link.Request) -> list[dict[str, object]]:
    return [{"address": address, "went": ahead} for address, ahead in went.items()]


async def main() -> None:
    async with server:
        await server.wait_connected()
        print(server.qr().for_page("phalanx:"), flush=True)
        await server.run()


with contextlib.suppress(KeyboardInterrupt):
    asyncio.run(main())
