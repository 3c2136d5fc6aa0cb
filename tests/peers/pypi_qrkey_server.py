"""The published server `QrkeyController` (PyPI qrkey 0.12.2) as a process that speaks JSON lines; README.md lists them.

Settings come from the environment, as the package reads them: MQTT_HOST, MQTT_PORT, MQTT_VERSION,
PIN_CODE_REFRESH_INTERVAL, PIN_CODE_REVOKE_DELAY, PIN_CODE_LENGTH. It also reads a file .env in the working directory.
"""

import argparse
import asyncio
import json
import logging
import sys
import threading
from collections.abc import Callable
from typing import Any

import structlog
from dotbot_fleet import Fleet
from qrkey import QrkeyController, SubscriptionModel

TICK_S = 0.2  # a DotBot advertises about this often

# What PyDotBot subscribes to. The echo takes any name.
DOTBOT_COMMANDS = ("move_raw", "rgb_led", "xgo_action", "waypoints", "clear_position_history")


def say(event: str, **fields: Any) -> None:
    """One line on stdout."""
    print(json.dumps({"event": event, **fields}), flush=True)


class PeerController(QrkeyController):
    """The package's controller without its web server."""

    async def api(self) -> None:
        # The original always binds 0.0.0.0:8080. Tests run side by side, and nothing of theirs belongs on a network.
        await asyncio.Event().wait()


class PinCodePage:
    """Stands where the package's own page would: it is told every new pin over a "websocket"."""

    async def send_text(self, text: str) -> None:
        say("rotated", pin=json.loads(text)["pin_code"])


class Peer:
    def __init__(self, root: str, fleet: Fleet | None) -> None:
        self.fleet = fleet
        self.controller = PeerController(self.on_request, structlog.get_logger(), root_topic=root)
        self.controller.websockets.append(PinCodePage())
        names = DOTBOT_COMMANDS if fleet else ("+",)
        self.subscriptions = [
            SubscriptionModel(topic=f"/command/+/+/+/{name}", callback=self.on_command) for name in names
        ]
        self._announce_when_subscribed()

    def _announce_when_subscribed(self) -> None:
        waiting = len(self.subscriptions) + 1  # and /request
        on_subscribe = self.controller.on_subscribe

        def counted(*args: Any) -> None:
            nonlocal waiting
            waiting -= 1
            if waiting == 0:
                say("ready", pin=self.controller.pin_code)
            # Last, because under gmqtt 0.8 the package's own callback ends in an AttributeError.
            on_subscribe(*args)

        self.controller.client.on_subscribe = counted

    def on_request(self, payload: Any) -> None:
        say("request", payload=payload)
        if not isinstance(payload, dict) or not isinstance(payload.get("reply"), str):
            return
        answer = self.fleet.answer(payload) if self.fleet else {"request": payload.get("request"), "data": payload}
        if answer is not None:
            self.controller.publish(f"/reply/{payload['reply']}", answer)

    def on_command(self, topic: str, payload: Any) -> None:
        say("command", topic=topic, payload=payload)
        if self.fleet is None:
            return
        _, _, _swarm, address, _application, name = topic.split("/")
        try:
            notification = self.fleet.command(address, name, payload)
        except (KeyError, TypeError, ValueError) as error:
            say("refused", topic=topic, reason=repr(error))
            return
        if notification is not None:
            self.controller.publish("/notify", notification)

    def on_order(self, order: dict[str, Any]) -> None:
        if order["do"] == "notify":
            self.controller.publish("/notify", order["payload"])
        elif order["do"] == "join" and self.fleet:
            self.controller.publish("/notify", self.fleet.join())
        else:
            say("error", reason=f"unknown order {order['do']}")

    async def tick(self) -> None:
        while self.fleet:
            self.fleet.step(TICK_S)
            for notification in self.fleet.updates():
                # Robots advertise each in their own time slot. Sent all at once, the published hook keeps the last.
                await asyncio.sleep(TICK_S / len(self.fleet.robots))
                self.controller.publish("/notify", notification)

    async def run(self) -> None:
        quit_ = asyncio.Event()
        read_orders(self.on_order, quit_)
        tasks = [
            asyncio.create_task(self.controller.start(self.subscriptions)),
            asyncio.create_task(self.tick()),
            asyncio.create_task(quit_.wait()),
        ]
        if self.fleet is None:
            tasks.pop(1).cancel()
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()  # a broker that is not there must be seen, not waited for
        await self.controller.client.disconnect()


def read_orders(on_order: Callable[[dict[str, Any]], None], quit_: asyncio.Event) -> None:
    """Calls on_order in the loop for each line of stdin, and sets quit_ at "quit" or the end of it."""
    loop = asyncio.get_running_loop()

    def read() -> None:
        for line in sys.stdin:
            order = json.loads(line)
            if order["do"] == "quit":
                break
            loop.call_soon_threadsafe(on_order, order)
        loop.call_soon_threadsafe(quit_.set)

    # A daemon: nothing can wake a thread that waits for stdin when the controller has ended first.
    threading.Thread(target=read, daemon=True).start()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", default="/qrkey", help="root topic; PyDotBot uses /pydotbot")
    parser.add_argument("--vocabulary", choices=("echo", "dotbot"), default="echo")
    parser.add_argument("--millimetres", action="store_true", help="speak as PyDotBot 0.30, not 0.28")
    options = parser.parse_args()

    # structlog prints to stdout unless told otherwise, and stdout is ours.
    structlog.configure(
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
    )
    fleet = Fleet(millimetres=options.millimetres) if options.vocabulary == "dotbot" else None
    asyncio.run(Peer(options.root, fleet).run())


if __name__ == "__main__":
    main()
