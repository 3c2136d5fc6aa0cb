"""The paper's Fig. 4: what is counted, what is kept when things go wrong, and that it is drawn from the CSV alone."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from brokers import bare_mosquitto
from commands import child
from phalanx.errors import Unavailable, UsageError
from phalanx.lab.figures.plot import draw
from phalanx.net.mosquitto import find_mosquitto
from phalanx.papers.figure import FIGURES
from phalanx.papers.link.fig4 import CSV_NAME, make_packet, measure
from phalanx.papers.link.fig4_table import KINDS, PAPER, Row, cells, head, packets, summarize
from phalanx.papers.table import TableFile, read_table
from pictures import looks_like_a_figure
from ports import free_port
from waiting import eventually

FIGURE = FIGURES["link-fig4"]
ORIGIN = {"broker": "mosquitto", "interval_s": 0.5, "lost_after_s": 10.0, "version": "0.0.0 (cafe)"}


def opened(path, **changed):
    return TableFile(path, head(**ORIGIN | changed), packets)


def rows_in(path):
    return packets(read_table(path))


QUICK = {"duration": 2, "interval_s": 0.02, "lost_after_s": 1}


def rows_of(*latencies_ms, kind="plain"):
    """One row a packet: a latency, or an outcome that has none."""
    return [
        Row(seq, kind, 1e9 + seq, what) if isinstance(what, str) else Row(seq, kind, 1e9 + seq, "back", what)
        for seq, what in enumerate(latencies_ms)
    ]


def write(path, rows, **changed):
    with opened(path, **changed) as file:
        for row in rows:
            file.append_line(cells(row))
    return path


def test_a_packet_is_twenty_characters_of_sequence_number_and_time():
    packet = make_packet(108_470, 1_700_000_000.1234)
    assert packet == "01084701700000000123"
    assert len(make_packet(0, 0.0)) == len(make_packet(9_999_999, 9_999_999_999.9)) == 20


def test_the_figures_of_a_table_made_by_hand():
    summary = summarize(rows_of(10.0, 200.0, 200.1, 300.0, 10.0, 201.0))
    assert (summary.sent, summary.lost, summary.late, summary.undecided) == (6, 0, 0, 0)
    assert summary.reliability_pct == 100
    assert summary.mean_ms == pytest.approx(921.1 / 6)
    assert (summary.median_ms, summary.p99_ms, summary.max_ms) == (pytest.approx(200.05), 300.0, 300.0)
    assert summary.slow_pct == 50  # 200.0 is not above 200
    assert summary.longest_slow_run == 2


def test_a_lost_packet_counts_as_slow_and_a_late_one_enters_the_mean():
    rows = [*rows_of(20.0, "lost", 400.0, "lost", 20.0), Row(5, "plain", 1e9, "late", 12_000.0)]
    summary = summarize(rows)
    assert (summary.sent, summary.lost, summary.late) == (6, 3, 1)
    assert summary.reliability_pct == 50
    assert summary.mean_ms == pytest.approx((20 + 400 + 20 + 12_000) / 4)
    assert summary.slow_pct == pytest.approx(100 * 4 / 6)
    assert summary.longest_slow_run == 3


def test_an_interrupted_packet_is_neither_back_nor_lost_and_ends_a_run():
    summary = summarize(rows_of(300.0, 300.0, "cut", 300.0, 300.0, 300.0))
    assert (summary.sent, summary.undecided, summary.lost) == (6, 1, 0)
    assert summary.longest_slow_run == 3
    # One that a crash left no row of is the same.
    missing = summarize([row for row in rows_of(300.0, 300.0, 1.0, 300.0) if row.seq != 2])
    assert (missing.sent, missing.undecided, missing.longest_slow_run) == (4, 1, 2)


def test_no_packet_back_and_no_packet_at_all():
    summary = summarize(rows_of("lost", "lost", "lost"))
    assert (summary.lost, summary.longest_slow_run, summary.reliability_pct, summary.slow_pct) == (3, 3, 0, 100)
    assert summary.mean_ms is summary.median_ms is summary.p99_ms is summary.max_ms is None
    nothing = summarize([])
    assert (nothing.sent, nothing.lost, nothing.longest_slow_run) == (0, 0, 0)
    assert nothing.reliability_pct is nothing.slow_pct is nothing.mean_ms is None


def test_rows_come_back_as_they_were_written_and_late_replaces_lost(tmp_path):
    rows = rows_of(1.5, "lost", "cut")
    path = write(tmp_path / "deep" / CSV_NAME, [*rows, Row(1, "plain", 1e9 + 1, "late", 11_000.25)])
    assert read_table(path).origin == ORIGIN
    assert rows_in(path) == {"plain": (rows[0], Row(1, "plain", 1e9 + 1, "late", 11_000.25), rows[2]), "sealed": ()}


@pytest.mark.parametrize(
    ("found", "why"),
    [
        (b"seq,kind\n0,plain\n", "not a CSV of link-fig4"),
        (b"my only copy, no newline", "not a CSV of link-fig4"),
        (b"\xff\xfe\n", "not a CSV of link-fig4"),
        (b"# phalanx link-fig4 {}\n", "not a CSV of link-fig4"),
        (b"# phalanx link-fig4 {}\nCOLUMNS", "measured with another broker"),
        (b"# phalanx link-fig4 []\n", "not a CSV of link-fig4"),
        (b"HEADseq,rtt\n", "other columns"),
        (b"HEADCOLUMNS0,plain,1.0,back,\n", "line 3 .* not a packet"),
        (b"HEADCOLUMNS0,plain,1.0,lost,3\n", "line 3 .* not a packet"),
        (b"HEADCOLUMNS0,plain,1.0,back,nan\n", "line 3 .* not a packet"),
        (b"HEADCOLUMNS0,plain,1.0,back,1\n1,secret,1.0,back,1\n", "line 4 .* not a packet"),
        (b"HEADCOLUMNS\n", "line 3 .* is malformed"),
    ],
)
def test_a_foreign_file_is_refused_in_one_line_and_left_alone(tmp_path, found, why):
    path = write(tmp_path / CSV_NAME, [])
    head, columns = path.read_bytes().splitlines(keepends=True)
    data = found.replace(b"HEAD", head).replace(b"COLUMNS", columns)
    path.write_bytes(data)
    with pytest.raises(UsageError, match=why) as refused:
        opened(path).__enter__()
    assert "\n" not in str(refused.value)
    assert refused.value.hint
    assert path.read_bytes() == data


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"broker": "mqtt://elsewhere:1883"}, "broker"),
        ({"interval_s": 1.0}, "interval_s"),
        ({"lost_after_s": 5.0}, "lost"),
    ],
)
def test_rows_of_another_configuration_are_refused_and_left_alone(tmp_path, change, name):
    path = write(tmp_path / CSV_NAME, rows_of(1.0))
    before = path.read_bytes()
    with pytest.raises(UsageError, match=name):
        opened(path, version="9", **change).__enter__()
    assert path.read_bytes() == before
    with opened(path, version="9") as file:  # another version is welcome
        assert len(packets(file.table)["plain"]) == 1


@pytest.mark.parametrize("duration", [0, float("nan"), 0.1, 1e9])
def test_a_duration_out_of_range_is_refused(duration):
    with pytest.raises(UsageError):
        FIGURE.check({"duration": duration})


@pytest.mark.waits
async def test_through_a_real_broker_every_packet_comes_back_plain_and_sealed(tmp_path):
    told = []
    path = await measure(tmp_path, lambda done, of: told.append((done, of)), **QUICK, broker="mosquitto")
    assert told == [(done, 100) for done in range(101)]
    for kind in KINDS:
        assert [row.seq for row in rows_in(path)[kind]] == list(range(100))
        assert {row.outcome for row in rows_in(path)[kind]} == {"back"}
        assert all(row.latency_ms > 0 for row in rows_in(path)[kind])
    # One after the other: both see the same network.
    sent = sorted((row.sent_at_s, row.kind) for kind in KINDS for row in rows_in(path)[kind])
    assert [kind for _, kind in sent[:6]] == ["plain", "sealed"] * 3
    # Finished: nothing is sent again. More is asked for: it goes on.
    before = path.read_bytes()
    await measure(tmp_path, **QUICK, broker="mosquitto")
    assert path.read_bytes() == before
    await measure(tmp_path, **QUICK | {"duration": 2.4}, broker="mosquitto")
    assert path.read_bytes().startswith(before)
    assert summarize(rows_in(path)["sealed"]).sent == 120
    with pytest.raises(UsageError, match="interval_s"):
        await measure(tmp_path, **QUICK | {"interval_s": 0.04}, broker="mosquitto")


@pytest.mark.waits
async def test_what_goes_over_the_wire_is_the_packet_and_an_envelope(tmp_path):
    import aiomqtt

    port = free_port()
    seen = []

    async def listen():
        async with aiomqtt.Client("127.0.0.1", port) as client:
            await client.subscribe("#")
            ready.set()
            async for message in client.messages:
                seen.append((str(message.topic), message.payload))

    with bare_mosquitto(port, free_port(), tmp_path) as (start, _):
        start()
        await answers(port)
        ready = asyncio.Event()
        listener = asyncio.create_task(listen())
        await ready.wait()
        await measure(tmp_path, duration=0.2, interval_s=0.02, broker=f"mqtt://127.0.0.1:{port}")
        await eventually(lambda: len(seen) == 20)
        listener.cancel()
    plain, sealed = seen[::2], seen[1::2]
    assert all(re.fullmatch(rb"[0-9]{20}", payload) for _, payload in plain)
    assert [int(payload[:7]) for _, payload in plain] == list(range(10))
    assert all(payload.startswith(b"eyJhbGciOiJkaXIiLCJlbmMiOiJBMjU2R0NNIn0..") for _, payload in sealed)
    topics = {topic for topic, _ in seen}
    assert len(topics) == 2
    assert all(re.fullmatch(r"/qrkey/[0-9A-Za-z_=-]{24}/notify", topic) for topic in topics)


async def answers(port):
    async def knock():
        try:
            _, writer = await asyncio.open_connection("127.0.0.1", port)
        except OSError:
            return False
        writer.close()
        return True

    deadline = time.monotonic() + 10
    while not await knock():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.02)


@pytest.mark.waits
async def test_a_broker_that_goes_and_comes_costs_packets_and_not_the_measurement(tmp_path):
    port = free_port()
    path = tmp_path / CSV_NAME

    def count(outcome):
        return path.exists() and path.read_text().count(outcome) > 10

    with bare_mosquitto(port, free_port(), tmp_path) as (start, kill):
        start()
        await answers(port)
        config = {"duration": 8, "interval_s": 0.02, "lost_after_s": 0.5}
        running = asyncio.create_task(measure(tmp_path, **config, broker=f"mqtt://127.0.0.1:{port}"))
        await eventually(lambda: count("back"))
        kill()
        await eventually(lambda: count("lost"))
        start()
        await running
    for kind in KINDS:
        rows = rows_in(path)[kind]
        summary = summarize(rows)
        assert summary.sent == len(rows) == 400
        assert summary.undecided == 0
        assert summary.lost > 5
        assert summary.longest_slow_run > 5
        assert rows[-1].outcome == "back"


@contextmanager
def a_process_of_mosquitto(port, folder):
    """A broker that can be stopped and continued, as a stalled network would be."""
    config = folder / "mosquitto.conf"
    config.write_text(f"allow_anonymous true\nlistener {port} 127.0.0.1\n")
    process = subprocess.Popen([find_mosquitto(), "-c", config], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.waits
async def test_packets_that_come_after_all_are_late_with_their_true_latency(tmp_path):
    port = free_port()
    path = tmp_path / CSV_NAME
    with a_process_of_mosquitto(port, tmp_path) as broker:
        await answers(port)
        config = {"duration": 4, "interval_s": 0.02, "lost_after_s": 0.3}
        running = asyncio.create_task(measure(tmp_path, **config, broker=f"mqtt://127.0.0.1:{port}"))
        await eventually(lambda: path.exists() and path.read_text().count("back") > 10)
        broker.send_signal(signal.SIGSTOP)
        await eventually(lambda: path.read_text().count("lost") > 10)
        broker.send_signal(signal.SIGCONT)
        await running
    for kind in KINDS:
        rows = rows_in(path)[kind]
        summary = summarize(rows)
        assert summary.sent == len(rows) == 200
        assert summary.lost == summary.late > 3  # TCP lost nothing: it all came, too late
        assert all(row.latency_ms > 300 for row in rows if row.outcome == "late")
        assert summary.max_ms > 300
        assert summary.mean_ms > summary.median_ms


@pytest.mark.waits
async def test_ctrl_c_does_not_wait_for_a_broker_that_hangs(tmp_path):
    port = free_port()
    csv = tmp_path / CSV_NAME
    with a_process_of_mosquitto(port, tmp_path) as broker:
        await answers(port)
        with child("reproduce", "link-fig4", "--broker", f"mqtt://127.0.0.1:{port}", "--out", str(tmp_path)) as ours:
            await eventually(lambda: csv.exists() and csv.read_bytes().count(b"\n") > 3)
            broker.send_signal(signal.SIGSTOP)
            await asyncio.sleep(1.2)
            assert ours.stop(timeout_s=5) == 1
    assert csv.read_text().endswith("\n")
    assert csv.read_text().count(",cut,\n") >= 2


@pytest.mark.waits
async def test_a_broker_that_never_was_is_told_in_one_line(tmp_path):
    with pytest.raises(Unavailable, match=r"no broker at mqtt://127\.0\.0\.1:\d+ within 0\.5 s"):
        await measure(tmp_path, duration=1, connect_timeout_s=0.5, broker=f"mqtt://127.0.0.1:{free_port()}")


@pytest.mark.waits
def test_ctrl_c_keeps_the_rows_and_the_same_command_goes_on(tmp_path):
    csv = tmp_path / CSV_NAME
    command = ("reproduce", "link-fig4", "--duration", "4", "--out", str(tmp_path), "--json")
    with child(*command) as first:
        deadline = time.monotonic() + 20
        while not csv.exists() or csv.read_bytes().count(b"\n") < 6:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        assert first.stop() == 1
        assert first.out == []
        assert "run the same command again to continue" in first.err[-1]
        assert not any("Traceback" in line for line in first.err)
    kept = csv.read_bytes()
    assert kept.endswith(b"\n")
    assert not (tmp_path / "link-fig4.png").exists()
    csv.write_bytes(kept + b"7,pla")  # and then the power went
    with child(*command) as second:
        assert second.wait(60) == 0, second.err
    assert csv.read_bytes().startswith(kept)
    said = json.loads(second.out[0])
    rows = {row["metric"]: row for row in said["rows"]}
    assert rows["sent"] == {"metric": "sent", "paper": 108471, "plain": 8, "sealed": 8}
    assert rows["slow_pct"]["paper"] == 1.194
    assert set(rows) > set(PAPER)
    assert [row.seq for row in rows_in(csv)["sealed"]] == list(range(8))
    looks_like_a_figure(tmp_path / "link-fig4.png")
    # Finished: only the table and the figure once more.
    (tmp_path / "link-fig4.png").unlink()
    before = csv.read_bytes()
    with child(*command[:-1]) as third:
        assert third.wait(60) == 0, third.err
    assert csv.read_bytes() == before
    assert third.out[0].split() == ["paper", "plain", "sealed"]
    assert any(line.split() == ["mean", "latency,", "ms", "21.55", *line.split()[-2:]] for line in third.out)
    looks_like_a_figure(tmp_path / "link-fig4.png")


@pytest.mark.waits
def test_a_foreign_csv_is_misuse_and_a_missing_broker_a_failure(tmp_path):
    csv = write(tmp_path / CSV_NAME, rows_of(1.0), broker="mqtt://a:1")
    before = csv.read_bytes()
    with child("reproduce", "link-fig4", "--duration", "1", "--out", str(tmp_path)) as refused:
        assert refused.wait() == 2
    assert [line for line in refused.err if line.startswith("phalanx: error: ")]
    assert refused.err[-1].startswith("phalanx: hint: ")
    assert csv.read_bytes() == before
    with child("reproduce", "link-fig4", "--broker", "mqtt://me:secret@localhost", "--out", str(tmp_path)) as login:
        assert login.wait() == 2
    assert "secret" not in "".join(login.err)


def test_the_figure_is_drawn_from_the_csv_alone_and_keeps_no_login(tmp_path):
    rows = [*rows_of(*[5.0, 30.0, 250.0] * 30, "lost"), *rows_of(*[6.0, 31.0] * 40, "cut", kind="sealed")]
    csv = write(tmp_path / CSV_NAME, rows)
    alone = tmp_path / "elsewhere" / "copy.csv"
    alone.parent.mkdir()
    shutil.copy(csv, alone)
    png, svg = draw(alone, FIGURE)
    assert sorted(path.name for path in alone.parent.iterdir()) == ["copy.csv", "copy.png", "copy.svg"]
    looks_like_a_figure(png)
    assert svg.read_text().lstrip().startswith("<?xml")


@pytest.mark.parametrize("rows", [[], rows_of("lost", "lost"), rows_of("cut"), rows_of(0.4)], ids=len)
def test_little_or_nothing_is_drawn_without_complaint(tmp_path, rows):
    looks_like_a_figure(draw(write(tmp_path / CSV_NAME, rows), FIGURE)[0])


def test_without_matplotlib_the_csv_is_kept_and_the_hint_given(tmp_path, monkeypatch):
    csv = write(tmp_path / CSV_NAME, rows_of(1.0))
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(Unavailable, match="matplotlib is not installed") as missing:
        draw(csv, FIGURE)
    assert missing.value.hint == "make setup, or pip install '.[reproduce]' in a clone"
    assert [path.name for path in tmp_path.iterdir()] == [CSV_NAME]
