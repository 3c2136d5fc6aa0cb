"""`phalanx sim view`: the lines that the page plays are what the run did; whatever a file is, one line says so."""

from __future__ import annotations

import os
import re
import struct

import aiohttp
import pytest
import zstandard
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from mcap.writer import CompressionType, Writer

from phalanx.cli import view as view_command
from phalanx.errors import Unavailable, UsageError
from phalanx.gateway.serve_view import ViewPages
from phalanx.net.site import serve_in_thread
from phalanx.recording import recorded
from phalanx.recording.recorded import Said
from phalanx.recording.recorder import NS, TOPICS, frame
from phalanx.world.audited.world import VerdictReader
from phalanx.world.scenarios import scenes
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.scenes import Live, Scenes, lines_of
from recorded_scenario import SCENARIO

ATTACK = KeyValuePair(key="attack", value="spoof")


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """A recording, the lines of the same run as it went on, and the run's own words at each step."""
    path, lines, steps = tmp_path_factory.mktemp("view") / "small.mcap", [], []
    live, readers = Live(SCENARIO, lines.append), {}

    def on_step(run):
        verdicts = readers.setdefault(run, VerdictReader(run.world)).new()
        live.write(run, verdicts)
        steps.append((run.now_s, run.positions_m, run.in_safe_mode, run.shields(), verdicts))

    run_scenario(SCENARIO, path, on_step)
    live.end()
    return path, lines, steps


def test_a_recording_and_the_run_that_goes_on_are_the_same_lines_and_what_the_run_did(seen):
    path, lines, steps = seen
    assert (lines_of(path)) == lines
    about, *moments = lines
    assert about["about"]["tokens_needed"] == "4"
    assert moments[0]["marks"] == [[80_000, 30_000]]
    assert len(moments[0]["walls"]) == scenes.CORNERS + 4
    assert [50_000, -60_000, 60_000, -60_000] in moments[0]["walls"]
    assert len(moments) == len(steps)
    for told, (now_s, positions_m, safe, shields, _) in zip(moments, steps, strict=True):
        assert told["t"] == pytest.approx(now_s)
        assert [row[:3] for row in told["at"]] == [
            [i + 1, *(round(1000 * each) for each in place)] for i, place in enumerate(positions_m.tolist())
        ]
        assert told["lies"] == [(4, "spoof")]
        assert [row[1] for row in told["shields"]] == safe.tolist()
        assert [len(row[2]) for row in told["shields"]] == [len(each) for each in shields]
    audits = [tuple(audit[1:3]) for told in moments for audit in told.get("audits", [])]
    assert audits == [verdict[1:3] for *_, verdicts in steps for verdict in verdicts]
    assert any(audit[3] for told in moments for audit in told.get("audits", []))
    events = [event[1:] for told in moments for event in told.get("events", [])]
    assert events == [[4, "in Safe Mode"]]


def test_a_file_that_was_cut_anywhere_is_shown_up_to_there_or_refused_in_a_line(seen, tmp_path, caplog):
    path, whole, _ = seen
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    shown = set()
    for length in range(1, len(data), len(data) // 15):
        cut.write_bytes(data[:length])
        try:
            lines = lines_of(cut)
        except UsageError as error:
            assert "cut.mcap" in str(error)
            continue
        assert lines[:-1] == whole[: len(lines) - 1]
        shown.add(len(lines))
        assert "is truncated" in caplog.text
    assert shown


def test_a_file_with_any_byte_turned_ends_in_lines_or_in_one_line(seen, tmp_path):
    data, turned = seen[0].read_bytes(), tmp_path / "turned.mcap"
    for at in range(0, len(data), len(data) // 30):
        turned.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        try:
            assert lines_of(turned)
        except UsageError as error:
            assert "turned.mcap" in str(error)


def chunk(data: bytes, says: int, compression: bytes = b"zstd") -> bytes:
    """A file with one chunk that says that it unpacks to so much."""
    words = struct.pack("<QQQII", 0, 0, says, 0, len(compression)) + compression + struct.pack("<Q", len(data)) + data
    return b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(words)) + words


@pytest.mark.parametrize("says", [0, 1000, 1 << 62])
def test_a_file_that_unpacks_to_more_than_is_read_is_refused_before_it_is_unpacked(tmp_path, monkeypatch, says):
    bomb = tmp_path / "bomb.mcap"
    bomb.write_bytes(chunk(zstandard.compress(bytes(recorded.MOST_CHUNK_BYTES + 1)), says))
    monkeypatch.setattr(recorded, "breakup_chunk", lambda _: pytest.fail("unpacked"))
    with pytest.raises(UsageError, match=r"bomb\.mcap unpacks to more"):
        (lines_of(bomb))
    bomb.write_bytes(chunk(b"", 1, b"lz4"))
    with pytest.raises(UsageError, match=r"bomb\.mcap is compressed as 'lz4'"):
        (lines_of(bomb))


def written(path, *frames, t_ns=0, steps=1):
    """A recording of these frames, by somebody else, a chunk a step."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, chunk_size=1)
        writer.start()
        channel = writer.register_channel("/tf", "protobuf", writer.register_schema("x", "protobuf", b""))
        for at_ns in range(t_ns, t_ns + steps * NS, NS):
            writer.add_message(channel, at_ns, TOPICS["/tf"](transforms=frames).SerializeToString(), at_ns)
        writer.finish()
    return path


def test_of_many_chunks_those_are_shown_that_are_whole(tmp_path, caplog):
    path = written(tmp_path / "x.mcap", frame(0, "robot-1", 1, 2, 0), steps=5)
    whole, data = lines_of(path), path.read_bytes()
    assert [line["t"] for line in whole] == [0, 1, 2, 3, 4]
    third = [at.start() for at in re.finditer(b"robot-1", data)][2]
    for length in range(third - 20, third + 20):
        path.write_bytes(data[:length])
        assert lines_of(path) == whole[:2]
    assert "is truncated" in caplog.text


@pytest.mark.parametrize(
    "said",
    [
        Said("/shields", 0, {"robots": [{"id": 1, "safe_mode": False, "tokens": [{"auditor": 2, "left_s": 1}] * 200}]}),
        Said("/scene", 0, TOPICS["/scene"](entities=[SceneEntity(id="robot-1", metadata=[ATTACK])])),
    ],
)
def test_all_that_a_line_holds_is_counted(said):
    lines: list = []
    told = Scenes(lines.append)
    for second in range(200):
        told.take(Said("/tf", second * NS, TOPICS["/tf"]()))
        if second == 0:
            told.take(said)
    told.close()
    assert told.told >= 200


def test_what_is_said_of_a_run_is_what_the_page_knows_once():
    lines: list = []
    told = Scenes(lines.append)
    for name in ("first", "second"):
        told.take(Said("metadata scenario", 0, {"name": name, "seed": "1" * 1000, "x" * 9999: "y"}))
    assert lines == [{"about": {"name": "first", "seed": "1" * scenes.LONGEST}}]


def test_a_message_of_more_discs_than_anybody_draws_is_refused_before_they_are_made():
    ground = SceneEntity(id="ground")
    ground.MergeFromString(SceneEntity(cylinders=[CylinderPrimitive()]).SerializeToString() * (scenes.MOST_DRAWN + 1))
    with pytest.raises(ValueError, match=str(scenes.MOST_DRAWN)):
        Scenes(lambda _: None).take(Said("/scene", 0, TOPICS["/scene"](entities=[ground])))


def test_a_pipe_is_no_recording_and_is_not_waited_for(tmp_path):
    for name in ("pipe", "pipe.mcap"):
        os.mkfifo(tmp_path / name)
        assert recorded.is_recording(tmp_path / name) == (name != "pipe")
        with pytest.raises(UsageError, match="is not a regular file"):
            (lines_of(tmp_path / name))


@pytest.mark.parametrize("x_m", [float("nan"), float("inf"), 1e300])
def test_a_place_that_is_none_is_one_line(tmp_path, x_m):
    with pytest.raises(UsageError, match="not a recording of phalanx"):
        (lines_of(written(tmp_path / "x.mcap", frame(0, "robot-1", x_m, 0, 0))))


def test_what_is_longer_than_a_page_keeps_says_so(seen, tmp_path, monkeypatch, caplog):
    path = written(tmp_path / "x.mcap", frame(0, "robot-1", 1, 2, 0), frame(0, "robot-2-believes", 1, 2, 0), t_ns=NS)
    assert lines_of(path) == [{"t": 1.0, "at": [[1, 1000, 2000, 0]], "lies": []}]
    assert not caplog.text
    monkeypatch.setattr(scenes, "MOST_VALUES", 100)
    assert 1 < len(lines_of(seen[0])) < 10
    assert "the end is not shown" in caplog.text


def test_misuse_is_one_line(phalanx, seen, tmp_path, monkeypatch):
    monkeypatch.setattr(view_command, "pages_are_built", lambda _: True)
    monkeypatch.setattr(view_command, "run", lambda job: pytest.fail(f"served {job.close()}"))
    path = str(seen[0])
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "other.mcap").write_bytes(b"hello " * 100)
    for words, complaint in (
        ([str(tmp_path / "none.mcap")], "cannot read"),
        ([str(tmp_path / "empty.mcap")], "not a recording"),
        ([str(tmp_path / "other.mcap")], "not a recording"),
        ([path, "--seed", "0"], "which options cannot change"),
        (["bti-fig0"], "no scenario"),
        (["flock-12", "--duration", "100000"], "exceed the page's memory"),
        ([path, "--port", "65536"], "65536"),
    ):
        code, out, err = phalanx("sim", "view", *words)
        assert (code in (1, 2), out) == (True, ""), words
        assert complaint in err
        assert "Traceback" not in err
    monkeypatch.setattr(view_command, "pages_are_built", lambda _: False)
    assert "make setup" in phalanx("sim", "view", path)[2]


@pytest.mark.waits
async def test_no_other_host_s_name_and_no_nonsense_is_answered_and_a_port_that_is_taken_is_named():
    async with serve_in_thread(ViewPages(0)) as pages, aiohttp.ClientSession(f"http://127.0.0.1:{pages.port}") as http:
        for path, headers, status in (
            ("/api/run", {"Host": "evil.test"}, 403),
            ("/api/run?from=-1", {}, 400),
            ("/api/run?from=9999999999", {}, 400),
            ("/api/run?from=1&run=another", {}, 409),
        ):
            async with http.get(path, headers=headers) as answer:
                assert answer.status == status, path
        pages.put({"t": 0.0})
        pages.put(None)
        for run in ("", answer.headers.get("Run", "")):
            async with http.get(f"/api/run?from=1&run={run}") as answer:
                assert await answer.text() == '{"end": true}\n'
                assert answer.headers["Run"]
        with pytest.raises(Unavailable, match="already in use") as refused:
            await ViewPages(pages.port).__aenter__()
        assert "--port 0" in refused.value.hint
