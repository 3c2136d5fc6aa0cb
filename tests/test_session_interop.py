"""The client in TypeScript against the server in Python, over a transport that drops, repeats, reorders and forges."""

from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from broker_world import Broker
from phalanx.link.session import EndReason, Invitation, Kind, Role, Secret
from phalanx.link.session.events import (
    Close,
    Commanded,
    Ended,
    Joined,
    KeepSecret,
    Publish,
    Requested,
    Send,
    SetTopics,
    Transmit,
    Updated,
)
from session_world import World

WEB = Path(__file__).parent.parent / "web"


class Node:
    """A process with sessions in TypeScript."""

    def __init__(self) -> None:
        command = ["node", "--import", "tsx", "tests/session_peer.ts", "seed"]
        self.process = subprocess.Popen(command, cwd=WEB, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, **order: Any) -> dict[str, Any]:
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert "error" not in answer, answer
        return answer

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def node() -> Iterator[Node]:
    made = Node()
    yield made
    made.close()


class Crossing:
    """A server in Python with clients in TypeScript; `spoil` may alter what is carried."""

    ids = 0

    def __init__(self, node: Node, **config: Any) -> None:
        self.node, self.world = node, World(**config)
        self.world.server.assignment.set_robots(["R1", "R2"], 0)
        self.happened: list[Any] = []
        self.events: dict[int, list[dict[str, Any]]] = {}
        self.rejected: dict[int, dict[str, int]] = {}
        self.closed: dict[int, str] = {}
        self.spoil = lambda data: [data]

    def join(self, invitation: Invitation | None = None, name: str = "Zoë") -> int:
        Crossing.ids += 1
        phone = Crossing.ids
        invitation = invitation or self.world.invitation()
        self.events[phone] = []
        self.carry(self.world.server.opened(phone, "10.0.0.1", self.world.now))
        secret = {"kind": invitation.secret.kind.name.lower(), "secret": invitation.secret.raw.hex()}
        self.node.ask(do="new", id=phone, static=invitation.static.hex(), name=name, now=0, **secret)
        self.ask(phone, "start")
        return phone

    def ask(self, phone: int, do: str, **words: Any) -> None:
        answer = self.node.ask(do=do, id=phone, now=self.world.ms, **words)
        self.rejected[phone] = answer["rejected"]
        for event in answer["events"]:
            self.events[phone].append(event)
            if event["kind"] == "transmit":
                for data in self.spoil(bytes.fromhex(event["data"])):
                    self.carry(self.world.server.receive(phone, data, self.world.now))
            if event["kind"] == "keep":
                self.ask(phone, "stored")

    def carry(self, events: list[Any]) -> None:
        for event in events:
            self.happened.append(event)
            if isinstance(event, Send):
                self.deliver(event.connection, event.data)
            elif isinstance(event, Publish):
                for connection in event.connections:
                    self.deliver(connection, event.data)
            elif isinstance(event, Close):
                self.closed[event.connection] = event.reason

    def deliver(self, phone: int, data: bytes) -> None:
        for each in self.spoil(data):
            self.ask(phone, "receive", data=each.hex())

    def publish(self, state: bytes) -> None:
        self.carry([self.world.server.publish(state, self.world.now)])

    def wait(self, ms: int, step_ms: int = 1000) -> None:
        for _ in range(0, ms, step_ms):
            self.world.ms += step_ms
            self.carry(self.world.server.tick(self.world.now))
            for phone in self.events:
                if phone not in self.closed:
                    self.ask(phone, "tick")

    def of(self, phone: int, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.events[phone] if event["kind"] == kind]


def test_a_page_joins_drives_asks_makes_new_keys_and_resumes(node):
    crossing = Crossing(node)
    zoe = crossing.join()
    assert crossing.of(zoe, "admitted") == [{"kind": "admitted", "visitor": 1, "name": "Zoë"}]
    crossing.publish("état".encode())
    assert crossing.of(zoe, "updated")[-1]["state"] == "état".encode().hex()
    crossing.ask(zoe, "command", robot="R1", name="move_raw", payload=b"{}".hex())
    assert [e for e in crossing.happened if isinstance(e, Commanded)] == [Commanded(1, "R1", "move_raw", b"{}", False)]
    crossing.ask(zoe, "request", name="robots", payload="")
    assert crossing.happened[-1] == Requested(1, 1, "robots", b"")
    crossing.carry(crossing.world.server.reply(1, 1, bytes(70_000)))
    assert len(crossing.of(zoe, "replied")[-1]["payload"]) == 140_000
    crossing.wait(700_000, 20_000)
    crossing.publish(b"later")
    assert crossing.of(zoe, "updated")[-1]["state"] == b"later".hex()
    assert len(crossing.of(zoe, "keep")) == 2
    secret = crossing.world.server.visitors.find(1).secrets()
    assert [each.raw.hex() for each in secret] == [crossing.of(zoe, "keep")[-1]["secret"]]
    again = crossing.join(crossing.world.invitation(secret[0]))
    assert crossing.of(again, "admitted")[-1]["visitor"] == 1
    assert crossing.of(zoe, "ended") == [{"kind": "ended", "reason": "replaced"}]
    assert not crossing.world.server.rejected
    assert crossing.rejected[again] == crossing.rejected[zoe] == {}


def test_a_page_reads_epochs_refusals_and_the_end(node):
    crossing = Crossing(node)
    zoe, eve = crossing.join(), crossing.join()
    crossing.ask(zoe, "command", robot="R1", name="move_raw", payload="")
    assert crossing.of(zoe, "refused") == [{"kind": "refused", "number": 0, "reason": "late"}]
    crossing.carry(crossing.world.operations.set_role(1, Role.WATCH, crossing.world.now))
    assert crossing.of(zoe, "stands")[-1]["standing"]["role"] == "watch"
    crossing.carry(crossing.world.operations.remove(2, crossing.world.now))
    assert crossing.of(eve, "ended") == [{"kind": "ended", "reason": "removed"}]
    crossing.publish(b"new epoch")
    assert crossing.of(zoe, "updated")[-1]["state"] == b"new epoch".hex()
    crossing.wait(1_000_000, 4_000)
    crossing.publish(b"and another")
    assert crossing.of(zoe, "updated")[-1]["state"] == b"and another".hex()
    assert crossing.world.server.updates.epochs()[0].epoch == 2


@pytest.mark.parametrize("seed", range(4))
def test_whatever_the_transport_does_nothing_is_done_twice_or_forged(node, seed):
    chance = random.Random(seed)
    crossing = Crossing(node, bad_records_max=1_000_000)
    zoe = crossing.join()
    held: list[bytes] = []

    def spoil(data: bytes) -> list[bytes]:
        held.append(data)
        match chance.randrange(7):
            case 0:
                return []
            case 1:
                return [data, data]
            case 2:
                return [chance.choice(held), data]
            case 3:
                at = chance.randrange(len(data))
                return [data[:at] + bytes([data[at] ^ 1 << chance.randrange(8)]) + data[at + 1 :]]
            case 4:
                return [data[: chance.randrange(len(data))]]
            case 5:
                other = chance.choice(held)
                return [data[:10] + other[10:]]
        return [data]

    crossing.spoil = spoil
    sent = []
    for n in range(60):
        crossing.world.ms += 200
        crossing.publish(f"state {n}".encode())
        sent.append(f"command {n}".encode())
        crossing.ask(zoe, "command", robot="R1", name="move_raw", payload=sent[-1].hex())
    done = [event.payload for event in crossing.happened if isinstance(event, Commanded)]
    assert done == [each for each in sent if each in done]
    assert 5 < len(done) < 60
    states = [int(bytes.fromhex(event["state"])[6:]) for event in crossing.of(zoe, "updated")]
    assert states == sorted(set(states))
    assert 5 < len(states) < 60
    assert len([event for event in crossing.happened if isinstance(event, Joined)]) == 1
    assert crossing.rejected[zoe]
    assert crossing.world.server.rejected
    crossing.spoil = lambda data: [data]
    crossing.publish(b"state 99")
    crossing.ask(zoe, "command", robot="R1", name="move_raw", payload=b"last".hex())
    assert crossing.happened[-1] == Commanded(1, "R1", "move_raw", b"last", False)


def test_the_secret_that_a_page_keeps_is_the_servers(node):
    crossing = Crossing(node)
    zoe = crossing.join()
    kept = crossing.of(zoe, "keep")[-1]["secret"]
    (valid,) = crossing.world.server.visitors.find(1).secrets()
    assert isinstance(valid, Secret)
    assert valid.raw.hex() == kept


class Page:
    """A client in TypeScript, as one in Python."""

    def __init__(self, node: Node, _config: Any, invitation: Invitation, _random: Any) -> None:
        Crossing.ids += 1
        self.node, self.id, self.is_joined = node, Crossing.ids, False
        words = {"static": invitation.static.hex(), "kind": invitation.secret.kind.name.lower()}
        words |= {"secret": invitation.secret.raw.hex(), "broker": invitation.broker, "root": invitation.root}
        node.ask(do="new", id=self.id, name="Zoë", now=0, mqtt=invitation.mqtt, **words)

    def ask(self, do: str, now_ms: int, **words: Any) -> list[Any]:
        answer = self.node.ask(do=do, id=self.id, now=now_ms, **words)
        self.is_joined = not answer["over"] and (
            self.is_joined or any(each["kind"] == "admitted" for each in answer["events"])
        )
        return [event for each in answer["events"] if (event := self.event(each))]

    def event(self, said: dict[str, Any]) -> Any:
        match said["kind"]:
            case "transmit":
                return Transmit(bytes.fromhex(said["data"]), said["topic"])
            case "hear":
                return SetTopics(tuple(said["topics"]))
            case "updated":
                return Updated(bytes.fromhex(said["state"]))
            case "keep":
                return KeepSecret(Secret(Kind.RESUME, bytes.fromhex(said["secret"])), said["lifetime_s"])
            case "ended":
                return Ended(EndReason[said["reason"].upper()] if said.get("reason") else None)
        return None

    def start(self, now_ms: int) -> list[Any]:
        return self.ask("start", now_ms)

    def receive(self, raw: bytes, now_ms: int) -> list[Any]:
        return self.ask("receive", now_ms, data=raw.hex())

    def tick(self, now_ms: int) -> list[Any]:
        return self.ask("tick", now_ms)

    def command(self, robot: str, name: str, payload: bytes, now_ms: int) -> Any:
        return self.ask("command", now_ms, robot=robot, name=name, payload=payload.hex())[0]

    def stored(self, _secret: Secret, now_ms: int) -> Any:
        return self.ask("stored", now_ms)[0]


def test_a_page_on_a_broker_changes_topics_with_its_keys_and_begins_anew_when_it_hears_nothing(node):
    broker = Broker()
    broker.makes = partial(Page, node)
    zoe = broker.join()
    broker.state(b"one")
    assert zoe.last(Updated) == Updated(b"one")
    assert broker.drive(zoe)
    before = {topic for topic, _ in broker.seen}
    broker.wait(1_800_000, 2000)
    broker.seen.clear()
    broker.state(b"two")
    assert zoe.last(Updated) == Updated(b"two")
    assert broker.drive(zoe)
    assert not {topic for topic, _ in broker.seen} & before
    assert len([event for event in broker.happened if isinstance(event, Joined)]) == 1
    broker.wait(4000, updates=False)
    assert zoe.client.is_joined
    broker.wait(2000, updates=False)
    assert zoe.last(Ended) == Ended(None)
    again = broker.join(zoe.kept)
    assert again.client.is_joined
    broker.carry(broker.world.operations.remove(1, broker.world.now))
    assert again.last(Ended) == Ended(EndReason.REMOVED)
    assert not broker.join(again.kept).client.is_joined


def test_a_page_on_a_broker_that_waits_for_approval_is_patient(node):
    broker = Broker()
    broker.makes = partial(Page, node)
    broker.server.visitors.set_approval(approval=True)
    zoe = broker.join()
    broker.wait(50_000)
    assert zoe.client.is_joined
    broker.wait(12_000)
    assert zoe.last(Ended) == Ended(None)
