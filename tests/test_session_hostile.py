"""Sessions over a transport that drops, repeats, reorders, reflects, splices, cuts and alters, for as long as it likes."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from phalanx.link.session import MemoryStore, Role, Secret
from phalanx.link.session.events import Close, Commanded, Joined, KeepSecret, Publish, Send, Transmit, Updated
from phalanx.wire.sessions import UPDATE
from session_world import Phone, World

LATE_MS = 1000
HEAD = 10  # bytes of a record's head


class Hostile(RuleBasedStateMachine):
    """The transport holds every message, and does with it what hypothesis wants."""

    def __init__(self) -> None:
        super().__init__()
        self.world = World(MemoryStore(), bad_records_max=1_000_000, commands_per_s=1_000_000)
        self.world.server.assignment.set_robots([f"R{n}" for n in range(1, 200)], 0)
        self.phones: list[Phone] = []
        self.up: dict[int, list[bytes]] = defaultdict(list)  # on the way
        self.down: dict[int, list[bytes]] = defaultdict(list)
        self.history: list[bytes] = []
        self.published: list[tuple[bytes, int]] = []  # state, and when
        self.said: dict[bytes, tuple[int, int, bool]] = {}  # payload: phone, update that it names, whether a stop
        self.done: list[bytes] = []
        self.visitor_of: dict[int, int] = {}  # phone: visitor
        self.born: dict[int, int] = {}  # phone: updates that were published before
        self.removed: dict[int, int] = {}  # visitor: updates that were published before
        self.secrets: dict[int, list[Secret]] = defaultdict(list)  # of visitors
        self.ticket = self.world.ticket().secret  # for one use, and everybody has it
        self.stayed: set[int] = set()  # visitors by the ticket that confirmed a secret
        self.count = 0

    # --- carrying out ---

    def serve(self, events: list[Any]) -> None:
        for event in events:
            match event:
                case Send(connection, data):
                    self.sent(self.down[connection], data)
                case Publish(connections, data):
                    for connection in connections:
                        self.sent(self.down[connection], data)
                case Joined(visitor):
                    assert visitor not in self.removed, "a removed visitor is back"
                case Commanded(visitor, robot, _, payload, is_stop):
                    self.commanded(visitor, robot, payload, is_stop)
                    self.serve(self.world.server.accept(event, self.world.now))
                case Close(connection, reason):
                    self.world.phones[connection].closed = reason

    def commanded(self, visitor: int, robot: str, payload: bytes, is_stop: bool) -> None:
        phone, seen, was_stop = self.said[payload]
        assert (visitor, robot) == (self.visitor_of[phone], f"R{phone}"), "another visitor's command"
        assert visitor not in self.removed
        assert payload not in self.done, "a command twice"
        assert is_stop == was_stop
        if not is_stop:
            assert self.world.ms - self.published[seen - 1][1] <= LATE_MS, "a late command"
            earlier = [each for each in self.done if self.said[each][0] == phone]
            assert all(int(each) < int(payload) for each in earlier), "an earlier command after a later one"
        self.done.append(payload)

    def sent(self, queue: list[bytes], data: bytes) -> None:
        queue.append(data)
        self.history.append(data)

    def act(self, phone: Phone, events: list[Any]) -> None:
        for event in events:
            phone.events.append(event)
            match event:
                case Transmit(data):
                    self.sent(self.up[phone.connection], data)
                case KeepSecret(secret):
                    phone.kept = secret
                    self.secrets[self.visitor_of[phone.connection]].append(secret)
                    self.act(phone, [phone.client.stored(secret, self.world.ms)])
                case Updated(state):
                    self.read(phone, state)
                case _ if type(event).__name__ == "Admitted":
                    assert self.visitor_of.setdefault(phone.connection, event.visitor) == event.visitor

    def read(self, phone: Phone, state: bytes) -> None:
        number = int(state)
        assert self.published[number - 1][0] == state, "a state that the swarm did not publish"
        states = [int(event.state) for event in phone.all(Updated)]
        assert states == sorted(set(states)), "an update again, or an earlier one"
        assert number > self.born[phone.connection], "an update from before the visitor came"
        before = self.removed.get(self.visitor_of[phone.connection])
        assert before is None or number <= before, "an update from after the visitor's removal"

    def to_server(self, connection: int, data: bytes) -> None:
        self.serve(self.world.server.receive(connection, data, self.world.now))

    def to_client(self, phone: Phone, data: bytes) -> None:
        self.act(phone, phone.client.receive(data, self.world.ms))

    def dial(self, secret: Secret | None) -> None:
        phone = self.world.dial(self.world.invitation(secret))
        self.phones.append(phone)
        self.born[phone.connection] = len(self.published)
        self.act(phone, phone.client.start(self.world.ms))

    # --- what people do ---

    @initialize()
    def somebody_comes(self) -> None:
        self.dial(None)
        self.all_arrives()
        self.the_state_is_published()

    @precondition(lambda self: len(self.phones) < 6)
    @rule()
    def a_visitor_comes(self) -> None:
        self.dial(None)

    @precondition(lambda self: len(self.phones) < 6)
    @rule()
    def somebody_comes_by_the_ticket(self) -> None:
        self.dial(self.ticket)

    @precondition(lambda self: len(self.phones) < 10 and self.secrets)
    @rule(data=st.data())
    def a_visitor_resumes(self, data: st.DataObject) -> None:
        visitor = data.draw(st.sampled_from(sorted(self.secrets)))
        self.dial(data.draw(st.sampled_from(self.secrets[visitor])))

    @rule()
    def the_state_is_published(self) -> None:
        state = str(len(self.published) + 1).encode()
        self.published.append((state, self.world.ms))
        self.serve([self.world.server.publish(state, self.world.now)])

    @precondition(lambda self: any(phone.client.is_joined for phone in self.phones))
    @rule(data=st.data(), stop=st.booleans())
    def a_visitor_commands(self, data: st.DataObject, stop: bool) -> None:
        phone = data.draw(st.sampled_from([each for each in self.phones if each.client.is_joined]))
        self.count += 1
        payload = str(self.count).encode()
        self.said[payload] = phone.connection, phone.client._reader.seen, stop
        robot = f"R{phone.connection}"
        self.act(phone, [phone.client.command(robot, "move_raw", payload, self.world.ms, stop=stop)])

    @rule(ms=st.sampled_from([10, 300, 900, 1100, 6000, 11_000, 610_000, 1_000_000]))
    def time_passes(self, ms: int) -> None:
        self.world.ms += ms
        self.world.unix_s += ms // 1000
        self.serve(self.world.server.tick(self.world.now))
        for phone in self.phones:
            self.act(phone, phone.client.tick(self.world.ms))

    @precondition(lambda self: len(self.removed) < 2 and len(self.world.server.visitors) > 1)
    @rule(data=st.data())
    def an_operator_removes_a_visitor(self, data: st.DataObject) -> None:
        visitor = data.draw(st.sampled_from(sorted(each.id for each in self.world.server.visitors)))
        self.removed[visitor] = len(self.published)
        self.serve(self.world.operations.remove(visitor, self.world.now))
        self.world.operations.open_door()

    # --- what the transport does ---

    @rule()
    def all_arrives(self) -> None:
        for _ in range(12):
            for phone in self.phones:
                for data in self.taken(self.up[phone.connection]):
                    self.to_server(phone.connection, data)
                for data in self.taken(self.down[phone.connection]):
                    self.to_client(phone, data)

    @staticmethod
    def taken(queue: list[bytes]) -> list[bytes]:
        data, queue[:] = list(queue), []
        return data

    @rule(data=st.data(), times=st.integers(0, 2))
    def one_arrives_out_of_order_twice_or_never(self, data: st.DataObject, times: int) -> None:
        waiting = [
            (phone, way) for phone in self.phones for way in ("up", "down") if getattr(self, way)[phone.connection]
        ]
        if not waiting:
            return
        phone, way = data.draw(st.sampled_from(waiting))
        queue = getattr(self, way)[phone.connection]
        message = queue.pop(data.draw(st.integers(0, len(queue) - 1)))
        for _ in range(times):
            if way == "up":
                self.to_server(phone.connection, message)
            else:
                self.to_client(phone, message)

    @rule(data=st.data(), how=st.sampled_from(["as it is", "cut", "altered", "spliced", "longer"]), up=st.booleans())
    def an_old_message_goes_anywhere(self, data: st.DataObject, how: str, up: bool) -> None:
        message = data.draw(st.sampled_from(self.history[-60:]))
        match how:
            case "cut":
                message = message[: data.draw(st.integers(0, len(message) - 1))]
            case "altered":
                at = data.draw(st.integers(0, len(message) - 1))
                message = message[:at] + bytes([message[at] ^ 1 << data.draw(st.integers(0, 7))]) + message[at + 1 :]
            case "spliced":
                other = data.draw(st.sampled_from(self.history[-60:]))
                at = data.draw(st.sampled_from([1, 2, HEAD, UPDATE.size - 64, UPDATE.size]))
                message = message[:at] + other[at:]
            case "longer":
                message += b"\0"
        phone = data.draw(st.sampled_from(self.phones))
        if up:
            self.to_server(phone.connection, message)
        else:
            self.to_client(phone, message)

    # --- what always holds ---

    @invariant()
    def nobody_was_admitted_who_did_not_come(self) -> None:
        assert len(self.world.server.visitors) + len(self.removed) <= len(self.phones)
        assert all(visitor.role is Role.DRIVE for visitor in self.world.server.visitors)
        assert not {visitor.id for visitor in self.world.server.visitors} & self.removed.keys()

    @invariant()
    def a_ticket_for_one_use_has_one_visitor(self) -> None:
        here = [each for each in self.world.server.visitors if each.ticket == self.ticket.id]
        self.stayed |= {each.id for each in here if not each.is_new}
        assert len(here) <= 1
        assert len(self.stayed) <= 1
        assert not here or here[0].is_new == bool(self.world.server.door.tickets())

    @invariant()
    def memory_is_bounded(self) -> None:
        for connection in self.world.server.connections:
            assert len(connection.channel.receive_ciphers()) <= 3
        for phone in self.phones:
            assert len(phone.client._early) <= 2
            assert len(phone.client._channel.receive_ciphers()) <= 2
        assert len(self.world.server.updates._sent) <= 64


Hostile.TestCase.settings = settings(
    max_examples=40, stateful_step_count=40, deadline=None, print_blob=False, suppress_health_check=list(HealthCheck)
)
TestSessionsOverAHostileTransport = Hostile.TestCase
