"""Recordings: what Foxglove reads is what the run did."""

from __future__ import annotations

import json
import math

import pytest
from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC
from mcap_protobuf.decoder import DecoderFactory

from phalanx.bti.refusal import Refusal
from phalanx.errors import Unavailable, UsageError
from phalanx.recording.recorded import read_recording
from phalanx.world.scenarios.play import STEP_S, run_scenario
from phalanx.world.scenarios.recording import HONEST, LIAR, NS, STOPPED
from recorded_scenario import SCENARIO


class Watched:
    """What the run itself said at each step."""

    def __init__(self) -> None:
        self.steps = []

    def __call__(self, run) -> None:
        self.steps.append((run.now_s, run.positions_m, run.velocities_mps, run.in_safe_mode, run.shields()))


def read(path):
    """Messages of each topic, with their times."""
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            value = message.data if channel.message_encoding == "json" else None
            if value is None:
                value = DecoderFactory().decoder_for(channel.message_encoding, schema)(message.data)
            found.setdefault(channel.topic, []).append((message.log_time / NS, value))
        metadata = [(each.name, each.metadata) for each in reader.iter_metadata()]
        counts = {
            reader.get_summary().channels[number].topic: count
            for number, count in reader.get_summary().statistics.channel_message_counts.items()
        }
    return found, metadata, counts


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "small.mcap"
    watched = Watched()
    run = run_scenario(SCENARIO, path, watched)
    return path, watched.steps, run


def colour(entity):
    return entity.cylinders[0].color.SerializeToString()


def test_the_file_says_what_was_run_and_is_whole(recorded):
    path, steps, _ = recorded
    found, metadata, counts = read(path)
    about = {"name": "small", "seed": "5", "defence": "hardened"}
    about |= {"duration_s": "17.1", "tokens_needed": "4", "t_val_ms": "10000"}
    assert metadata == [("scenario", about)]
    assert {topic: len(messages) for topic, messages in found.items()} == counts
    assert len(steps) == math.ceil(SCENARIO.duration_s / STEP_S) + 1
    assert steps[-1][0] == SCENARIO.duration_s
    assert counts["/tf"] == counts["/shields"] == len(steps) == counts["/scene"] - 1


def test_robots_are_where_they_were_and_in_the_colour_of_what_they_are(recorded):
    path, steps, run = recorded
    found, _, _ = read(path)
    colours = set()
    for (now_s, positions_m, _, safe, shields), (t_s, update) in zip(steps, found["/scene"][1:], strict=True):
        assert t_s == pytest.approx(now_s, abs=1e-9)
        assert [entity.id for entity in update.entities] == [f"robot-{rob_id}" for rob_id in run.ids]
        for i, entity in enumerate(update.entities):
            place = entity.cylinders[0].pose.position
            assert (place.x, place.y) == (positions_m[i, 0], positions_m[i, 1])
            expected = STOPPED if safe[i] else LIAR if i + 1 == 4 else HONEST
            assert colour(entity) == expected.SerializeToString()
            colours.add(expected.SerializeToString())
            said = {pair.key: pair.value for pair in entity.metadata}
            assert said["attack"] == ("spoof" if i + 1 == 4 else "")
            assert said["tokens"].count("(") == len(shields[i])
    assert len(colours) == 3, "the liar was seen lying, and stopped"


def test_frames_look_where_the_robot_goes(recorded):
    path, steps, _ = recorded
    found, _, _ = read(path)
    for (_, positions_m, velocities_mps, _, _), (_, frames) in zip(steps, found["/tf"], strict=True):
        for i, frame in enumerate(frames.transforms):
            assert (frame.parent_frame_id, frame.child_frame_id) == ("world", f"robot-{i + 1}")
            assert (frame.translation.x, frame.translation.y) == (positions_m[i, 0], positions_m[i, 1])
            speed = math.hypot(*velocities_mps[i])
            if speed > 0:
                turned_rad = 2 * math.atan2(frame.rotation.z, frame.rotation.w)
                assert math.cos(turned_rad) == pytest.approx(velocities_mps[i, 0] / speed, abs=1e-9)
                assert math.sin(turned_rad) == pytest.approx(velocities_mps[i, 1] / speed, abs=1e-9)


def test_shields_are_the_run_s(recorded):
    path, steps, _ = recorded
    found, _, _ = read(path)
    most = 0
    for (now_s, _, _, safe, shields), (_, data) in zip(steps, found["/shields"], strict=True):
        told = json.loads(data)
        assert told["t_s"] == now_s
        for i, robot in enumerate(told["robots"]):
            assert (robot["id"], robot["safe_mode"]) == (i + 1, bool(safe[i]))
            tokens = [(token["auditor"], token["left_s"]) for token in robot["tokens"]]
            assert tokens == [(auditor, pytest.approx(left_s, abs=1e-3)) for auditor, left_s in shields[i]]
            most = max(most, len(tokens))
    assert most > SCENARIO.bti.f_max


def test_every_verdict_is_logged_and_who_was_stopped(recorded):
    path, _, run = recorded
    found, _, _ = read(path)
    said = [(t_s, entry.name, entry.message, entry.level) for t_s, entry in found["/log"]]
    passed = [each for each in said if each[2].startswith("gives a token to robot")]
    refused = [each for each in said if each[2].startswith("refuses a token to robot 4: ")]
    robots = run.world.fleet.robot
    assert len(passed) == robots.audits_passed.sum() > 0
    assert len(refused) == robots.audits_refused.sum() > 0
    assert {level for *_, level in passed} == {1}
    assert {level for *_, level in refused} == {3}
    reasons = {message.split(": ")[1].replace(" ", "_").upper() for _, _, message, _ in refused}
    assert reasons <= set(Refusal.__members__)
    (stopped,) = [each for each in said if each[2] == "in Safe Mode"]
    assert stopped[1] == "robot-4"
    (told,) = run.summary()["compromised"]
    assert 0 <= stopped[0] - told["safe_mode_s"] <= STEP_S
    assert all(t_s <= SCENARIO.duration_s for t_s, *_ in said)


def test_goal_and_obstacles_are_there_from_the_start(recorded):
    path, _, _ = recorded
    t_s, update = read(path)[0]["/scene"][0]
    assert t_s == 0
    (ground,) = update.entities
    goal, disc = ground.cylinders
    assert MessageToDict(goal.pose.position) == {"x": 80.0, "y": 30.0}
    assert (disc.pose.position.x, disc.pose.position.y, disc.size.x) == (40, 60, 6)
    (box,) = ground.cubes
    assert (box.pose.position.x, box.pose.position.y, box.size.x, box.size.y) == (55, -57.5, 10, 5)


def test_the_same_run_gives_the_same_file_and_is_the_same_unrecorded(recorded, tmp_path):
    path, _, run = recorded
    again = tmp_path / "again.mcap"
    run_scenario(SCENARIO, again)
    assert again.read_bytes() == path.read_bytes()
    assert run_scenario(SCENARIO).summary()["digest"] == run.summary()["digest"]


def test_a_recording_that_is_interrupted_has_its_index(tmp_path):
    class Enough(Exception):
        pass

    def stop(run):
        if run.now_s >= 1:
            raise Enough

    path = tmp_path / "short.mcap"
    with pytest.raises(Enough):
        run_scenario(SCENARIO, path, stop)
    found, _, counts = read(path)
    assert counts["/tf"] == 5
    assert found["/tf"][-1][0] == 1.0


def test_where_nothing_can_be_written_one_line_says_so(tmp_path):
    with pytest.raises(UsageError, match="no folder"):
        run_scenario(SCENARIO, tmp_path / "none" / "x.mcap")
    with pytest.raises(Unavailable, match="cannot write"):
        run_scenario(SCENARIO, tmp_path)


def test_what_was_cut_short_at_once_is_told_from_what_is_no_recording(tmp_path):
    path = tmp_path / "cut.mcap"
    for data, what in (
        (MCAP0_MAGIC + b"\x01\x40", "was cut short before its first message"),
        (b"", "is not a rec"),
    ):
        path.write_bytes(data)
        with pytest.raises(UsageError, match=what):
            list(read_recording(path, ""))
