"""What must hold for every input: parsers are total, messages count once, secrets open nothing else."""

from __future__ import annotations

import contextlib
import itertools
import json
import os

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phalanx.config import LinkConfig
from phalanx.crypto import Key, open_jwe, seal_jwe
from phalanx.errors import BadPayload, CacheFull, OpenError, PeerError, Replayed, Stale, UsageError
from phalanx.gateway import vocabulary
from phalanx.link import ClientSide, Command, ServerSide, parse_qr_url
from phalanx.link.envelope import encode_envelope, open_envelope, seal
from phalanx.link.messages import Rejected
from phalanx.link.replay import ReplayCache
from phalanx.link.topics import split_topic

NOW = 1_700_000_000.0
KEY = Key(bytes(range(32)))
SERVER = ServerSide(LinkConfig(), os.urandom, 0.0)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
wild_values = json_values | st.floats() | st.binary(max_size=8)


@given(st.binary(max_size=2000))
@example(b"." * 1000)
@example(b"eyJhbGciOiJkaXIiLCJlbmMiOiJBMjU2R0NNIn0....")
def test_garbage_is_only_ever_an_open_error(token):
    with pytest.raises(OpenError):
        open_envelope(token, SERVER.epoch, NOW, ReplayCache(9, 30), 4096)


@given(json_values)
def test_what_is_sealed_opens_to_the_same(payload):
    token = seal(encode_envelope(payload, NOW), SERVER.epoch, os.urandom(12))
    opened = open_envelope(token, SERVER.epoch, NOW, ReplayCache(9, 30), 1 << 20)
    assert opened.payload == payload


@given(st.data())
def test_altering_any_byte_is_refused(data):
    token = seal(encode_envelope({"left_y": 60}, NOW), SERVER.epoch, os.urandom(12))
    i = data.draw(st.integers(0, len(token) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda b: b != token[i]))
    altered = token[:i] + bytes([byte]) + token[i + 1 :]
    with pytest.raises(OpenError):
        open_envelope(altered, SERVER.epoch, NOW, ReplayCache(9, 30), 4096)


@given(st.data())
def test_cutting_or_adding_bytes_is_refused(data):
    token = seal(encode_envelope([1], NOW), SERVER.epoch, os.urandom(12))
    i = data.draw(st.integers(0, len(token)))
    j = data.draw(st.integers(0, len(token)))
    altered = token[:i] + token[j:]
    if altered != token:
        with pytest.raises(OpenError):
            open_envelope(altered, SERVER.epoch, NOW, ReplayCache(9, 30), 4096)


@given(st.binary(min_size=32, max_size=32).filter(lambda raw: raw != KEY.raw))
def test_another_key_opens_nothing(raw):
    with pytest.raises(PeerError):
        open_jwe(seal_jwe(b"secret", KEY, bytes(12)), Key(raw), 4096)


@given(wild_values, st.sampled_from(["payload", "timestamp", "other"]))
def test_any_plaintext_is_an_envelope_or_refused(value, key):
    words = {"timestamp": NOW, "payload": 1, key: value}
    try:
        plaintext = json.dumps(words, default=lambda raw: raw.hex()).encode()
    except ValueError:
        return
    server = ServerSide(LinkConfig(), os.urandom, 0.0)
    token = seal(plaintext, server.epoch, os.urandom(12))
    for sub in ("request", "command/0000/A/0/x", "notify", "nonsense"):
        server.receive(f"/qrkey/{server.epoch.topic}/{sub}", token, NOW, 0.0)


@given(st.text(max_size=200))
def test_any_topic_splits_or_is_refused(topic):
    with pytest.raises(PeerError):
        split_topic("/qrkey", "t", topic)
    server = ServerSide(LinkConfig(), os.urandom, 0.0)
    assert isinstance(server.receive(topic, b"x", NOW, 0.0), Rejected)


@given(st.text(max_size=300))
def test_any_text_is_a_link_or_one_clear_line(text):
    try:
        parse_qr_url(text)
    except UsageError as error:
        assert "\n" not in str(error)
        assert error.hint


@given(st.text(alphabet="0123456789&=#?:/pinbrokewsv%", max_size=80))
def test_a_link_that_is_refused_is_not_repeated(tail):
    pin = "314159265358979323846264338327950288419"
    try:
        parse_qr_url(f"http://x/#v=1&pin={pin}&broker={tail}")
    except UsageError as error:
        assert pin not in str(error) + error.hint


class TestReplayCache:
    @given(
        st.lists(
            st.tuples(st.integers(0, 5), st.floats(-40, 40), st.floats(-5, 20), st.sampled_from("ab")), max_size=60
        )
    )
    def test_a_message_is_accepted_at_most_once_whatever_the_clock_does(self, steps):
        cache, now, accepted = ReplayCache(1000, 30.0), 1000.0, set()
        timestamps: dict[tuple[str, int], float] = {}
        for iv, skew, pass_s, epoch in steps:
            now += pass_s  # the clock may be set back
            # An IV belongs to one sealed message, so to one timestamp.
            timestamp = timestamps.setdefault((epoch, iv), now + skew)
            try:
                cache.enter(epoch, bytes([iv] * 12), timestamp, now)
            except (Stale, Replayed):
                continue
            assert (epoch, iv) not in accepted
            accepted.add((epoch, iv))

    @given(st.lists(st.tuples(st.integers(0, 50), st.floats(0, 10)), max_size=80), st.integers(1, 10))
    def test_it_never_grows_beyond_its_capacity_and_never_forgets_early(self, steps, capacity):
        cache, now = ReplayCache(capacity, 30.0), 1000.0
        live: dict[int, float] = {}
        for iv, pass_s in steps:
            now += pass_s
            try:
                cache.enter("e", bytes([iv] * 12), live.get(iv, now), now)
                assert iv not in live
                live[iv] = now
            except Replayed:
                assert iv in live
            except Stale:
                assert live[iv] + 30 < now + 1e-6 or live[iv] + 31 > now
            except CacheFull:
                assert len(cache) == capacity
            assert len(cache) <= capacity

    def test_a_burst_however_it_is_dated_takes_no_room_of_what_comes_a_moment_later(self):
        cache, now = ReplayCache(6200, 30.0), 1000.0
        burst = [number.to_bytes(12, "big") for number in range(6200)]
        took = 0
        for number, iv in enumerate(burst):
            with contextlib.suppress(CacheFull):
                cache.enter("e", iv, now - 29.0 + number % 59, now)
                took += 1
        assert took == len(cache) == 775
        for tenth in range(1, 600):
            then = now + tenth / 10
            cache.enter("e", tenth.to_bytes(12, "little"), then, then)
        with pytest.raises(Replayed):
            cache.enter("e", burst[58], now + 29.0, now + 59.0)

    def test_a_flood_without_end_does_not_fill_it(self):
        cache, numbers = ReplayCache(6200, 30.0), itertools.count()
        for tenth in range(2000):
            now = 1000.0 + tenth / 10
            for _ in range(20):  # 200 a second, where 87.5 are taken, each for as long as it can be
                with contextlib.suppress(CacheFull):
                    cache.enter("e", next(numbers).to_bytes(12, "big"), now + 29.9, now)
        assert 5000 < len(cache) < 6200


class TestVocabulary:
    @given(wild_values | st.dictionaries(st.sampled_from(["left_x", "left_y", "right_x", "right_y"]), wild_values))
    def test_wheels_come_out_whole_and_in_range_or_not_at_all(self, payload):
        try:
            move = vocabulary.parse_move_raw(payload)
        except BadPayload:
            return
        assert all(isinstance(w, int) and -100 <= w <= 100 for w in (move.left_pct, move.right_pct))

    @given(wild_values | st.dictionaries(st.sampled_from(["red", "green", "blue"]), wild_values))
    def test_colours_come_out_whole_and_in_range_or_not_at_all(self, payload):
        try:
            led = vocabulary.parse_rgb_led(payload)
        except BadPayload:
            return
        assert all(isinstance(c, int) and 0 <= c <= 255 for c in (led.red, led.green, led.blue))

    @given(
        wild_values
        | st.fixed_dictionaries(
            {
                "threshold": wild_values | st.integers(1, 1000),
                "waypoints": wild_values
                | st.lists(st.dictionaries(st.sampled_from("xyz"), wild_values | st.integers(0, 2000)), max_size=70),
            }
        )
    )
    @settings(max_examples=100)
    def test_routes_come_out_inside_the_area_or_not_at_all(self, payload):
        try:
            route = vocabulary.parse_waypoints(payload, (2000, 2000))
        except BadPayload:
            return
        assert len(route.points) <= vocabulary.MAX_WAYPOINTS
        assert all(0 <= p.x_mm <= 2000 and 0 <= p.y_mm <= 2000 for p in route.points)

    @pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), True, "5", None, 10**400])
    def test_numbers_that_are_none_are_refused(self, value):
        for parse, payload in (
            (vocabulary.parse_move_raw, {"left_y": value, "right_y": 0}),
            (vocabulary.parse_rgb_led, {"red": value, "green": 0, "blue": 0}),
            (lambda p: vocabulary.parse_waypoints(p, (9, 9)), {"threshold": value, "waypoints": []}),
        ):
            with pytest.raises(BadPayload):
                parse(payload)


def test_a_client_survives_ten_thousand_garbled_messages():
    client = ClientSide(LinkConfig(), os.urandom, SERVER.epoch.pin, "c")
    (note,) = SERVER.notify({"cmd": 1}, NOW)
    for i in range(10_000):
        token = bytearray(note.payload)
        token[i % len(token)] ^= 1 + i % 255
        assert isinstance(client.receive(note.topic, bytes(token), NOW), Rejected)
    assert sum(client.rejected.values()) == 10_000
    assert not isinstance(client.receive(note.topic, note.payload, NOW), Rejected)
    publish = client.request(0, NOW)
    assert not isinstance(SERVER.receive(publish.topic, publish.payload, NOW, 0.0), Command | Rejected)
