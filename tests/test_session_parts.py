"""Parts of a session: window, padding, records, updates, invitations. Each refuses what it must, and changes nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.session import SessionConfig
from phalanx.errors import NotAuthentic, PeerError, Replayed, TooLarge, UsageError
from phalanx.link.session import BadInvitation, Invitation, Kind, Secret, parse_invitation, parse_room_code
from phalanx.link.session.channel import Channel
from phalanx.link.session.errors import UnknownEpoch
from phalanx.link.session.invitation import new_room_code, shown_room_code
from phalanx.link.session.messages import Epoch, NewSecret
from phalanx.link.session.noise import Cipher, Keys
from phalanx.link.session.padding import pad, padded_size, unpad
from phalanx.link.session.secret import NO_ID, derive
from phalanx.link.session.updates import SKIP_LIMIT, UpdateReader, UpdateWriter
from phalanx.link.session.window import COUNTER_LIMIT, WIDTH, Window
from phalanx.wire import MalformedRecord
from phalanx.wire.sessions import INVITATION, RECORD, UPDATE
from session_world import PUBLIC, random_source

# --- window ---


@settings(deadline=None)
@given(st.lists(st.integers(0, 3 * WIDTH), max_size=200))
def test_no_counter_passes_twice_and_none_of_the_last_1024_is_lost(counters):
    window, passed = Window(), set()
    for counter in counters:
        newest = max(passed, default=-1)
        try:
            window.check(counter)
        except Replayed:
            assert counter in passed or counter <= newest - WIDTH
        else:
            assert counter not in passed
            assert counter > newest - WIDTH
            window.enter(counter)
            passed.add(counter)


def test_a_jump_costs_no_memory_and_the_largest_counters_are_refused():
    window = Window()
    window.enter(COUNTER_LIMIT - 1)
    assert window._seen.bit_length() <= WIDTH
    for counter in (COUNTER_LIMIT - 1, COUNTER_LIMIT, 2**64 - 1, 0):
        with pytest.raises(Replayed):
            window.check(counter)


# --- padding ---


@pytest.mark.parametrize(
    ("length", "size"),
    [(0, 128), (124, 128), (125, 512), (508, 512), (509, 2048), (2044, 2048), (2045, 4096), (4093, 6144)],
)
def test_plaintexts_have_few_sizes(length, size):
    assert padded_size(length) == size
    assert len(pad(b"x" * length, 1 << 20)) == size
    assert unpad(pad(b"x" * length, 1 << 20)) == b"x" * length


def test_other_padding_is_refused():
    good = pad(b"hello", 4096)
    for bad in (b"", good[:-1], good + b"\0", good[:-1] + b"\1", good + bytes(384), b"\xff\xff\xff\xff" + good[4:]):
        with pytest.raises(MalformedRecord):
            unpad(bad)
    with pytest.raises(UsageError):
        pad(bytes(125), 128)


# --- records ---


def ends(overlap_ms: int = 10_000) -> tuple[Channel, Channel]:
    sizes = {"max_receive_bytes": 4096, "max_send_bytes": 4096, "overlap_ms": overlap_ms}
    return Channel(is_server=True, **sizes), Channel(is_server=False, **sizes)


def keys(seed: str) -> Keys:
    take = random_source(seed)
    return Keys(Cipher(take(32)), Cipher(take(32)), take(32))


def opened() -> tuple[Channel, Channel]:
    server, client = ends()
    server.offer(keys("0"), 0)
    client.adopt(0, keys("0"), 0)
    assert server.open(client.seal(b"first"), 0) == (b"first", True, True)
    return server, client


def test_keys_that_were_offered_take_effect_with_the_first_record():
    server, client = ends()
    server.offer(keys("0"), 0)
    client.adopt(0, keys("0"), 0)
    assert not server.is_open
    with pytest.raises(UsageError):
        server.seal(b"too early")
    record = client.seal(b"first")
    assert server.open(record, 0) == (b"first", True, True)
    assert server.is_open
    with pytest.raises(Replayed):
        server.open(record, 0)
    assert server.open(client.seal(b"second"), 0) == (b"second", False, True)
    assert client.open(server.seal(b"back"), 0) == (b"back", False, True)


def test_a_record_is_refused_elsewhere_altered_cut_off_or_sent_back():
    server, client = opened()
    record = client.seal(b"drive")
    for at in range(len(record)):
        altered = bytearray(record)
        altered[at] ^= 0x40
        with pytest.raises(PeerError):
            server.open(bytes(altered), 0)
    for length in range(len(record)):
        with pytest.raises(PeerError):
            server.open(record[:length], 0)
    with pytest.raises(PeerError):
        server.open(record + b"\0", 0)
    with pytest.raises(PeerError):
        client.open(record, 0)
    other, _ = opened()
    other.offer(keys("1"), 0)
    with pytest.raises(PeerError):
        other.open(client.seal(b"spliced")[:30] + record[30:], 0)
    assert server.open(record, 0) == (b"drive", False, True)


def test_keys_before_are_accepted_for_ten_seconds_after_the_new_ones():
    server, client = opened()
    slow = [client.seal(b"slow 1"), client.seal(b"slow 2")]
    server.offer(keys("1"), 1000)
    old = server.seal(b"old")
    client.adopt(server.next_generation, keys("1"), 1100)
    assert server.open(client.seal(b"ready"), 1200) == (b"ready", True, True)
    assert client.open(server.seal(b"new"), 1300) == (b"new", False, True)
    assert client.open(old, 11_299) == (b"old", False, False)
    assert server.open(slow[0], 11_199) == (b"slow 1", False, False)
    with pytest.raises(NotAuthentic):
        server.open(slow[1], 11_200)


def test_a_handshake_that_was_not_confirmed_changes_nothing():
    server, client = opened()
    server.offer(keys("1"), 1000)
    server.offer(keys("2"), 2000)
    assert server.open(client.seal(b"still here"), 3000) == (b"still here", False, True)
    client.adopt(server.next_generation, keys("1"), 3000)
    with pytest.raises(NotAuthentic):
        server.open(client.seal(b"keys that were replaced"), 3000)
    client.adopt(server.next_generation, keys("2"), 3000)
    assert server.open(client.seal(b"these"), 3000) == (b"these", True, True)


def test_a_record_that_is_too_large_is_not_read():
    server, _ = opened()
    with pytest.raises(TooLarge):
        server.open(RECORD.encode(generation=0, counter=9, sealed=bytes(4096 + 17)), 0)


# --- updates ---

SIGNER = Ed25519PrivateKey.from_private_bytes(bytes(32))


def writer(now_ms: int = 0, **config) -> UpdateWriter:
    return UpdateWriter(SessionConfig(**config), SIGNER, random_source("epochs"), now_ms)


def reader(made: UpdateWriter) -> UpdateReader:
    opening = UpdateReader(SessionConfig(), made.public)
    for epoch in made.epochs():
        opening.learn(epoch)
    return opening


def test_an_update_opens_once_and_none_before_the_newest():
    made = writer()
    reading = reader(made)
    first, second, third = (made.seal(bytes([n]), n) for n in range(3))
    assert reading.open(second) == b"\1"
    for again in (first, second):
        with pytest.raises(Replayed):
            reading.open(again)
    assert reading.open(third) == b"\2"


def test_a_newcomer_opens_nothing_that_was_sent_before():
    made = writer()
    earlier = [made.seal(b"secret", n) for n in range(5)]
    newcomer = reader(made)
    (epoch,) = made.epochs()
    for update in earlier:
        with pytest.raises(Replayed):
            newcomer.open(update)
        fields = UPDATE.decode(update)
        # Nor by any key that follows from what it was given.
        newer = UpdateReader(SessionConfig(), made.public)
        newer.learn(replace(epoch, counter=fields["counter"]))
        with pytest.raises(NotAuthentic):
            newer.open(update)
    assert newcomer.open(made.seal(b"now", 6)) == b"now"


def test_only_the_swarm_signs_and_every_byte_is_signed():
    made, other = (
        writer(),
        UpdateWriter(SessionConfig(), Ed25519PrivateKey.from_private_bytes(b"o" * 32), random_source("epochs"), 0),
    )
    reading, reading_other = reader(made), reader(other)
    update = made.seal(b"state", 0)
    forged = other.seal(b"state", 0)  # by a visitor, which has the epoch's key
    with pytest.raises(NotAuthentic, match="signature"):
        reading.open(forged)
    for at in range(len(update)):
        with pytest.raises(PeerError):
            reading.open(update[:at] + bytes([update[at] ^ 1]) + update[at + 1 :])
        with pytest.raises(PeerError):
            reading.open(update[:at])
    assert reading.open(update) == b"state"
    assert reading_other.open(forged) == b"state"


def test_a_forged_counter_far_ahead_costs_no_hashes():
    made = writer()
    reading = reader(made)
    fields = UPDATE.decode(made.seal(b"state", 0))
    with pytest.raises(UnknownEpoch):
        reading.open(UPDATE.encode(**fields | {"counter": SKIP_LIMIT + 2}))
    chain = reading._chains[0]
    with pytest.raises(NotAuthentic):
        reading.open(UPDATE.encode(**fields | {"counter": SKIP_LIMIT}))
    assert chain.counter == 1


def test_the_next_epoch_is_known_before_it_is_used():
    made = writer(epoch_ms=1000, epoch_notice_ms=200)
    reading = reader(made)
    assert made.tick(700) is None
    assert reading.open(made.seal(b"a", 700)) == b"a"
    coming = made.tick(800)
    assert coming is not None
    late = reader(made)
    assert made.tick(900) is None
    reading.learn(coming)
    assert reading.open(made.seal(b"b", 900)) == b"b"
    assert made.tick(1000) is None
    update = made.seal(b"c", 1000)
    assert UPDATE.decode(update)["epoch"] == coming.epoch == 1
    assert reading.open(update) == late.open(update) == b"c"


def test_after_a_removal_the_next_update_is_under_a_key_that_only_those_have_who_got_it():
    made = writer()
    removed, stays = reader(made), reader(made)
    before = made.seal(b"a", 0)
    epoch = made.begin(1)
    update = made.seal(b"b", 2)
    assert removed.open(before) == b"a"
    with pytest.raises(UnknownEpoch):
        removed.open(update)
    stays.learn(epoch)
    assert stays.open(update) == b"b"
    with pytest.raises(PeerError):
        stays.open(before)


def test_a_removal_also_drops_the_next_epoch_which_the_removed_one_has():
    made = writer(epoch_ms=1000, epoch_notice_ms=200)
    removed = reader(made)
    removed.learn(made.tick(900))
    made.begin(950)
    assert made.tick(1000) is None
    for ms in (1100, 1950, 1960):
        made.tick(ms)
        with pytest.raises(UnknownEpoch):
            removed.open(made.seal(b"b", ms))


def test_a_command_is_late_if_its_update_is_older_than_a_second_forgotten_or_not_ours():
    made = writer()
    reading = reader(made)
    assert not made.is_recent(reading.seen, reading.digest, 0)
    reading.open(made.seal(b"a", 1000))
    assert made.is_recent(reading.seen, reading.digest, 2000)
    assert not made.is_recent(reading.seen, reading.digest, 2001)
    assert not made.is_recent(reading.seen, bytes(8), 1000)
    assert not made.is_recent(reading.seen + 1, reading.digest, 1000)
    for _ in range(64):
        made.seal(b"more", 1000)
    assert not made.is_recent(reading.seen, reading.digest, 1000)


# --- invitations ---


def test_an_invitation_travels_in_a_fragment():
    secret = Secret(Kind.TICKET, bytes(range(16)))
    for broker in ({}, {"broker": "wss://broker.example:8884/mqtt", "root": "/lab", "mqtt": 5}):
        invitation = Invitation(PUBLIC, secret, **broker)
        word = invitation.fragment()
        for text in (word, "#" + word, f" http://10.0.0.7:8080/?x=1#{word}\n"):
            read = parse_invitation(text)
            assert replace(read, secret=secret) == invitation
            assert (read.secret.kind, read.secret.raw) == (secret.kind, secret.raw)


@pytest.mark.parametrize(
    "values",
    [
        {"broker": b"http://x"},
        {"broker": b"ws://x y"},
        {"broker": b"ws://u:p@x/"},
        {"broker": b""},
        {"root": b"lab"},
        {"root": b"/+/#"},
        {"root": b""},
        {"mqtt": 3},
        {"mqtt": 0},
        {"kind": 3},
        {"kind": 4},
        {"kind": 9},
        {"root": b"/\xff"},
    ],
    ids=str,
)
def test_other_invitations_are_refused_and_not_repeated(values):
    good = {"kind": 1, "static": PUBLIC, "secret": b"\x5a" * 16, "mqtt": 5, "root": b"/lab", "broker": b"ws://b:1/mqtt"}
    from phalanx.crypto.jwe import encode_base64url

    raw = INVITATION.encode(**good | values)
    with pytest.raises(BadInvitation) as caught:
        parse_invitation("j=" + encode_base64url(raw).decode())
    assert "WlpaWl" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "j=", "#x", "j=AQ", "j=" + "A" * 2000, "j=é", "#v=1&pin=123456789012"])
def test_what_is_no_invitation_is_refused(text):
    with pytest.raises(BadInvitation):
        parse_invitation(text)


def test_a_room_code_is_eight_digits_as_people_type_them():
    for text in ("1234 5678", "12345678", " 1234-5678\n"):
        secret = parse_room_code(text)
        assert (secret.raw, secret.id) == (b"12345678", NO_ID)
    for text in ("1234 567", "1234 56789", "1234567a", "".join(chr(0xFF11 + n) for n in range(8))):
        with pytest.raises(BadInvitation) as caught:
            parse_room_code(text)
        assert "567" not in str(caught.value)
    assert shown_room_code("00012345") == "0001 2345"
    digits = [new_room_code(random_source(str(n))) for n in range(2000)]
    assert {len(each) for each in digits} == {8}
    counts = [sum(each.count(str(d)) for each in digits) for d in range(10)]
    assert min(counts) > 1400 < max(counts) < 1800  # of 1600
    with pytest.raises(BadInvitation):
        Invitation(PUBLIC, parse_room_code("1234 5678"), "ws://b/mqtt", "/lab", 5)
    with pytest.raises(UsageError):
        Invitation(PUBLIC, parse_room_code("1234 5678")).fragment()


# --- secrets ---


def test_what_is_derived_for_one_purpose_is_not_what_is_for_another():
    raw = bytes(range(32))
    made = [derive(raw, purpose, 32) for purpose in (b"open", b"ticket", b"room", b"resume", b"id", b"mac1", b"accept")]
    assert len(set(made)) == len(made)
    assert len({Secret(kind, raw).psk for kind in Kind}) == len(Kind)


def test_printing_shows_no_secret():
    secret = Secret(Kind.OPEN, b"SECRETSECRETSECR")
    take = random_source("x")
    things = [
        secret,
        Invitation(PUBLIC, secret),
        NewSecret(b"SECRET" * 6, 1),
        Epoch(1, 1, b"SECRET" * 6, b"t"),
        keys("SECRET"),
        writer(),
        opened(),
        Cipher(b"SECRET" * 5 + b"SE"),
        take,
    ]
    for thing in things:
        assert "SECRET" not in repr(thing)
        assert "534543524554" not in repr(thing)
