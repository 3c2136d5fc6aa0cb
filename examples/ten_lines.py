"""Your own robots behind the link: python examples/ten_lines.py [BROKER]"""

import asyncio
import contextlib
import sys
from collections import Counter

from phalanx import link
from phalanx.gateway.vocabulary import parse_move_raw

server = link.Server(sys.argv[1] if len(sys.argv) > 1 else "mqtt://127.0.0.1:1883")
turned = {name: Counter(left=0, right=0) for name in ("ROBOT-1", "ROBOT-2")}  # wheels: percent, added up


@server.on_command("move_raw")
async def drive(command: link.Command) -> None:
    if command.address in turned:  # authentic, but not necessarily valid: any holder of the code may send it
        move = parse_move_raw(command.payload)  # wheels in percent, or BadPayload, which is counted
        turned[command.address].update(left=move.left_pct, right=move.right_pct)
        await server.notify({"driven": command.address, "wheels": (move.left_pct, move.right_pct)})


@server.on_request(0)
def robots(_: link.Request) -> list[dict[str, object]]:
    return [{"address": address, "wheels": wheels} for address, wheels in turned.items()]


async def main() -> None:
    async with server:
        await server.wait_connected()
        print(server.qr().for_page("phalanx:"), flush=True)
        await server.run()


with contextlib.suppress(KeyboardInterrupt):
    asyncio.run(main())
