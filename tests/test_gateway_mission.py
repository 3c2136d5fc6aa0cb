"""Robots on a mission behind the gateway: what visitors are told, and the operator's desk."""

from __future__ import annotations

import asyncio
import json
import math
import os
import signal
import time
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from commands import child
from mission_swarms import NOW, PLAN, SMALL, THROUGH, Silent, a_mission_gateway, addresses, orders, plain_of
from phalanx.cli.main import run_command
from phalanx.cli.mission.files import read_plain
from phalanx.errors import PhalanxError, Unknown, UsageError
from phalanx.gateway.missions.watch import MissionWatch
from phalanx.gateway.shields import ShieldWatch
from phalanx.mission import BuildOptions, build, public_key, sign
from phalanx.mission.landmarks import floorplan_of_yaml
from phalanx.mission.refused import AlreadyStarted, NotForUs, OutsideWindow
from phalanx.net import Client
from phalanx.robot.on_mission import Completed, Decoded, NotValidated, OnMission, drift_of
from phalanx.robot.swarm import AuditedSwarm
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.missions.live import Moment, RobotTruth
from phalanx.world.missions.orders import orders_of
from phalanx.world.swarms.mission import MOST_ROBOTS, MissionSwarm, ShieldedMissionSwarm
from waiting import eventually, wait_until

NONE = [0, 0, 0]  # learnt of a robot's wheels


class TestSwarm:
    def test_places_and_directions_are_those_of_a_map_with_y_down(self):
        swarm = Silent()
        assert swarm.area_mm == (8000, 6000)
        assert [swarm.to_area(*place).y_mm for place in ((0.0, 6.0), (0.0, 0.0))] == [0.0, 6000.0]
        assert min(swarm.walls_mm()) == [0, 0, 0, 6000]
        for heading in range(0, 360, 15):
            swarm._truths[0] = RobotTruth(1.0, 1.0, math.radians(heading), "seeking", "")
            robot = swarm.robots()[0]
            nose = math.radians(robot.direction_deg)
            # (-sin, cos) with y down is where the robot looks, (cos, -sin) of its heading.
            assert -math.sin(nose) == pytest.approx(math.cos(math.radians(heading)), abs=0.01)
            assert math.cos(nose) == pytest.approx(-math.sin(math.radians(heading)), abs=0.01)

    def test_nobody_drives_a_robot_on_a_mission_and_everybody_may_light_it(self):
        swarm = Silent()
        first = addresses(swarm)[0]
        for refused in (lambda: swarm.drive(first, 50, 50), lambda: swarm.follow(first, [], 60)):
            with pytest.raises(Unknown, match="mission"):
                refused()
        with pytest.raises(Unknown, match="no robot"):
            swarm.set_led("NOBODY", swarm.robots()[0].led)

    def test_only_what_a_robot_decoded_is_known(self):
        swarm = Silent()
        swarm.begin(orders())
        assert swarm.progress().left == 2
        assert swarm.lit() == []
        swarm.say(Decoded(0, 0, "start", (1.5, 3.0), ""), Decoded(1, 0, "start", (1.5, 3.0), ""))
        assert (swarm.progress().left, len(swarm.lit())) == (1, 1)
        swarm.say(Decoded(0, 1, "door", (5.0, 3.0), "doorway"), Completed(0), phases=("done", "seeking"))
        assert [(lit.at.x_mm, lit.at.y_mm, lit.type) for lit in swarm.lit()] == [
            (1500, 3000, ""),
            (5000, 3000, "doorway"),
        ]
        progress = swarm.progress()
        assert (progress.nodes, progress.left, progress.completed) == (2, 0, 1)
        assert [(walk.phase, walk.decoded, walk.of) for walk in swarm.walks()] == [("done", 2, 2), ("seeking", 1, 2)]

    def test_a_node_without_a_place_counts_and_lights_nothing(self):
        swarm = Silent()
        swarm.begin(orders())
        swarm.say(Decoded(0, 1, "red", None, ""))
        assert (swarm.progress().left, list(swarm.lit())) == (1, [])

    def test_another_mission_begins_in_the_dark_and_what_was_on_its_way_of_the_old_one_is_dropped(self):
        swarm = Silent()
        swarm.begin(orders())
        swarm.say(Decoded(0, 0, "start", (1.5, 3.0), ""), at=((4.0, 3.0), (1.5, 3.0)))
        swarm.begin(orders())
        assert (swarm.progress().left, list(swarm.lit()), list(swarm.news())) == (2, [], [])
        assert swarm.robots()[0].at.x_mm == 1500
        assert len(swarm.robots()[0].history) == 0
        old = (1, Moment((RobotTruth(4.0, 3.0, 0.0, "done", ""),) * 2, (Completed(0),)))
        swarm.poll, swarm.recv = iter([True, False]).__next__, lambda: old
        assert {robot.at.x_mm for robot in swarm.robots()} == {1500}
        assert swarm.progress().completed == 0

    def test_a_mission_is_begun_once_by_those_it_is_for_and_in_its_time(self):
        swarm = Silent()
        told = orders()
        swarm.begin(told)
        with pytest.raises(AlreadyStarted):
            swarm.begin(told)
        with pytest.raises(NotForUs):
            swarm.begin(orders(robots=(7,)))
        with pytest.raises(OutsideWindow):
            swarm.begin(orders(valid_to_s=1000))
        assert len(swarm.sent) == 1
        assert swarm.progress().id == told.parts[0].mission.header.mission_id.hex()

    @pytest.mark.parametrize(
        ("plan", "count", "message"),
        [
            (b"size: [10, 10]\nstart_pose: [3.0, 1.5, 1.57]\n", 1, "0 walls"),
            (SMALL.replace("start_pose: [1.5, 3.0, 0.0]", "").encode(), 1, "has no start"),
            (SMALL.encode(), 0, "0 robots"),
            (SMALL.encode(), MOST_ROBOTS + 1, f"{MOST_ROBOTS + 1} robots"),
        ],
    )
    def test_what_cannot_live_a_mission_is_refused(self, plan, count, message):
        with pytest.raises(UsageError, match=message):
            MissionSwarm(floorplan_of_yaml(plan), count, 0, time.time)

    def test_no_robot_is_put_into_a_wall(self):
        with pytest.raises(UsageError, match="no robot can stand at 'start'"):
            orders(THROUGH.replace("position: [1.5, 3.0]", "position: [4.95, 1.0]"))
        with pytest.raises(UsageError, match="no robot can stand"):
            orders(THROUGH.replace("position: [1.5, 3.0]", "position: [-3, 1.0]"))

    def test_codes_of_the_author_hang_on_the_walls(self):
        told = orders_of(
            read_plain("delivery"), build(read_plain("delivery"), BuildOptions(), os.urandom), load_floorplan()
        )
        assert [code.text for code in told.plan.codes] == ["7d1f0c52a9e84b3666c0e2f1b8d49a07"]
        assert len(told.controller) == 1

    def is_held(self, swarm) -> bool:
        swarm.hold()
        time.sleep(0.5)
        before = swarm.robots()
        time.sleep(1)
        after = swarm.robots()
        swarm.release()
        assert after[0].heard_at_s > before[0].heard_at_s, "heard, as before"
        return [robot.at for robot in after] == [robot.at for robot in before]

    @pytest.mark.alone
    def test_robots_live_it_in_a_process_of_their_own_stand_while_held_and_end_with_it(self):
        with MissionSwarm(PLAN, 2, 0, time.time) as swarm:
            swarm.begin(orders())
            deadline = time.monotonic() + 60
            longest, held = 0.0, False
            while swarm.progress().completed < 2:
                assert time.monotonic() < deadline, swarm.walks()
                time.sleep(0.05)
                began = time.monotonic()
                swarm.robots()
                longest = max(longest, time.monotonic() - began)
                if not held and any(walk.phase == "seeking" for walk in swarm.walks()):
                    held = self.is_held(swarm)
            # Whoever asks does not wait for a search.
            assert longest < 0.1
            assert held
            assert swarm.progress().left == 0
            assert all(abs(robot.at.x_mm - 5000) < 4000 for robot in swarm.robots())
            assert any(len(robot.history) > 3 for robot in swarm.robots())
            process = swarm._process
        assert not process.is_alive()

    def test_robots_whose_process_dies_are_not_heard_any_more(self, caplog):
        now = [NOW]
        with MissionSwarm(PLAN, 1, 0, lambda: now[0]) as swarm:
            swarm._process.kill()
            swarm._process.join()
            swarm.robots()
            now[0] += 100
            assert swarm.robots()[0].heard_at_s == NOW
            with pytest.raises(PhalanxError, match="process has ended"):
                swarm.begin(orders())
        assert "no longer updated" in caplog.text


@pytest.mark.waits
class TestShields:
    def test_robots_audit_each_other_on_their_mission_and_one_that_lies_is_stopped(self):
        with ShieldedMissionSwarm(PLAN, 4, 0, time.time, "hardened", 1) as swarm:
            assert isinstance(swarm, AuditedSwarm)
            assert isinstance(swarm, OnMission)
            liar, *honest = addresses(swarm)
            (attack,) = swarm.attacks()
            with pytest.raises(Unknown, match="on no mission"):
                swarm.compromise(liar, attack.name)
            with pytest.raises(Unknown, match="no attack"):
                swarm.compromise(liar, "smile")
            watch = ShieldWatch(swarm, lambda _: None)
            assert watch.health(0) == "none", "they wait for a mission"
            swarm.begin(orders())
            assert watch.health(0) == "not working"
            wait_until(lambda: all(len(shield.vouchers) >= shield.needed for shield in swarm.shields()), 60)
            assert {audit.refusal for audit in swarm.new_audits()} == {""}
            swarm.compromise(liar, attack.name)
            wait_until(lambda: swarm.shields()[0].attack == attack.name, 10)
            wait_until(lambda: swarm.shields()[0].safe_mode, 60)
            assert swarm.shields()[0].vouchers == ()
            assert (swarm.walks()[0].phase, swarm.walks()[0].why) == ("held", "Safe Mode")
            refusals = {audit.refusal for audit in swarm.new_audits() if audit.auditee == liar}
            assert {"output wrong"} <= refusals <= {"", "output wrong"}
            wait_until(
                lambda: swarm.shields() and swarm.progress().completed == 3, 120
            )  # it hears of robots as it is asked
            assert not any(shield.safe_mode for shield in swarm.shields()[1:])
            assert [shield.address for shield in swarm.shields()] == [liar, *honest]
            swarm._process.kill()
            wait_until(lambda: swarm.shields() == (), 10)

    def test_without_audits_there_are_no_shields_to_show(self):
        assert not isinstance(Silent(), AuditedSwarm)


class TestWatch:
    def watched(self):
        swarm, said = Silent(), []
        return swarm, MissionWatch(swarm, said.append), said

    def number(self, address):
        return int(address[-1]) - 1

    def test_frames_tell_what_is_new_and_once_a_second_which_mission_runs(self):
        swarm, watch, said = self.watched()
        first = watch.news(self.number, 10.0)
        assert first == {
            "mission": [],
            "lit": [],
            "walks": [[0, "waiting", 0, 0, "", NONE], [1, "waiting", 0, 0, "", NONE]],
        }
        assert watch.in_area() == {"walls": 6, "mission": None}
        swarm.begin(orders())
        mission_id = swarm.progress().id[:16]
        assert watch.news(self.number, 10.1)["mission"] == [[mission_id, 2, 2]]
        swarm.say(Decoded(0, 0, "start", (1.5, 3.0), ""), NotValidated(1, "timed out"))
        news = watch.news(self.number, 10.2)
        assert news["mission"] == [[mission_id, 2, 1]]
        assert news["lit"] == [[1500, 3000, ""]]
        assert news["walks"] == [[0, "seeking", 1, 2, "", NONE], [1, "seeking", 0, 2, "", NONE]]
        assert watch.news(self.number, 10.3) == {"mission": [], "lit": [], "walks": []}
        assert watch.news(self.number, 11.4)["mission"] == [[mission_id, 2, 1]]
        assert [event["what"] for event in said] == ["begun", "decoded", "not validated"]
        assert said[1] == {
            "event": "mission",
            "robot": "DECAFBAD00000001",
            "who": "Ada",
            "what": "decoded",
            "node": 0,
            "name": "start",
            "decoded": 1,
            "of": 2,
        }
        assert said[2]["reason"] == "timed out"

    def test_a_drift_alone_is_told_once_a_second_and_with_all_else_at_once(self):
        swarm, watch, _ = self.watched()
        swarm.begin(orders())
        watch.news(self.number, 10.0)
        swarm.say(drift=(29, -48, 12))
        assert [row[5] for row in watch.news(self.number, 10.1)["walks"]] == [[29, -48, 12]] * 2
        swarm.say(drift=(30, -48, 12))
        assert watch.news(self.number, 10.2)["walks"] == []
        assert [row[5] for row in watch.news(self.number, 11.1)["walks"]] == [[30, -48, 12]] * 2
        swarm.say(drift=(31, -48, 12), phases=("held", "seeking"))
        assert [row[0] for row in watch.news(self.number, 11.2)["walks"]] == [0]
        assert watch.state()["robots"][addresses(swarm)[1]]["drift"] == [31, -48, 12]

    def test_what_a_belief_has_learnt_is_told_in_thousandths_and_hundredths_of_a_degree(self):
        assert drift_of(0.0294, -0.0481, math.radians(-0.123)) == (29, -48, -12)

    def test_another_mission_lights_anew(self):
        swarm, watch, said = self.watched()
        for _ in range(2):
            swarm.begin(orders())
            watch.news(self.number, 0.0)
            swarm.say(Decoded(0, 0, "start", (1.5, 3.0), ""))
            assert watch.news(self.number, 0.1)["lit"] == [[1500, 3000, ""]]
        assert [event["what"] for event in said] == ["begun", "decoded"] * 2

    def test_nothing_tells_where_a_dark_node_is(self):
        swarm, watch, _ = self.watched()
        swarm.begin(orders())
        swarm.say(Decoded(0, 0, "start", (1.5, 3.0), ""))
        told = json.dumps([watch.news(self.number, 0.0), watch.in_list(), watch.in_area(), watch.lit(), watch.state()])
        assert "5000" not in told
        assert "5.0" not in told
        assert '"door"' not in told


@pytest.mark.waits
class TestUp:
    async def test_a_visitor_is_told_the_building_and_what_is_decoded_and_drives_nobody(self, tmp_path):
        world, mission = tmp_path / "small.yaml", tmp_path / "through.yaml"
        world.write_text(SMALL)
        mission.write_text(THROUGH)
        with a_mission_gateway("--mission", str(mission), "--world", str(world), "--robots", "2") as (up, ready):
            up.wait_for("mission")
            async with Client(ready["qr_url"]) as visitor:
                area = await visitor.request("area")
                assert (area["width"], area["height"], area["walls"]) == (8000, 6000, 6)
                assert area["mission"][1] == 2
                assert len(await visitor.request("walls")) == 6
                robots = await visitor.robots()
                assert [len(robot["walk"]) for robot in robots] == [5, 5]
                await visitor.command(robots[0]["address"], "move_raw", {"left_y": 50, "right_y": 50})
                await visitor.command(robots[0]["address"], "waypoints", {"threshold": 60, "waypoints": []})
                await visitor.command(robots[0]["address"], "rgb_led", {"red": 1, "green": 2, "blue": 3})

                async def completed():
                    return len([e for e in up.events("mission") if e["what"] == "completed"]) == 2

                await eventually_async(completed, 60)
                lit = await visitor.request("lit")
                assert sorted(lit) == [[1500, 3000, ""], [5000, 3000, "doorway"]]
                robots = await visitor.robots()
                assert [robot["walk"][0] for robot in robots] == ["done", "done"]
                assert robots[0]["rgb_led"] == {"red": 1, "green": 2, "blue": 3}
            await eventually(lambda: up.events("rejected"))
            assert {event["reason"] for event in up.events("rejected")} == {"unknown"}
            assert up.events("mission")[0]["what"] == "begun"
            assert not [line for line in up.err if "error" in line]

    def test_a_sealed_file_runs_with_its_key_and_a_trusted_signature(self, tmp_path, ed25519_files, capsys):
        trusted, stranger, path = ed25519_files
        with a_mission_gateway("--mission", str(path), "--trust", trusted, "--world", str(tmp_path / "small.yaml")) as (
            up,
            _,
        ):
            assert up.wait_for("mission")["nodes"] == 2
        with child("up", "--events", "--mission", str(path), "--trust", stranger) as running:
            assert running.wait() == 1
            assert "which is not trusted" in running.err[-1]
        path.with_name(path.name + ".key").unlink()
        assert run_command(["up", "--events", "--mission", str(path)]) == 2
        assert "needs its start key" in capsys.readouterr().err.splitlines()[-2]

    def test_people_are_told_what_begins_and_ends_and_ctrl_c_ends_all(self, tmp_path):
        (tmp_path / "small.yaml").write_text(SMALL)
        (tmp_path / "through.yaml").write_text(THROUGH)
        words = ("--mission", str(tmp_path / "through.yaml"), "--world", str(tmp_path / "small.yaml"), "--robots", "1")
        with child("up", "--port", "0", *words) as running:
            wait_until(lambda: any(line == "Ada completed the mission" for line in running.out), 500)
            assert "mission through: 2 nodes, all still encrypted" in running.out
            children = Path(f"/proc/{running.process.pid}/task/{running.process.pid}/children").read_text().split()
            assert len(children) >= 2, "the front end and the robots"
            # As a terminal does it: everybody hears of it.
            for process in (running.process.pid, *map(int, children)):
                os.kill(process, signal.SIGINT)
            assert running.wait() == 0
            assert not any("Traceback" in line for line in running.err)
            wait_until(lambda: not [process for process in children if Path(f"/proc/{process}").exists()], 10)

    @pytest.mark.parametrize(
        ("arguments", "code", "said"),
        [
            (["--mission", "nowhere.yaml"], 2, "no file nowhere.yaml"),
            (["--mission", "office", "--robots", "3", "--defence", "hardened"], 2, "3 robots are too few"),
            (["--mission", "office", "--trust", "00" * 32], 2, "for encoded missions"),
            (["--start-key", "x"], 2, "for encoded missions"),
            (["--mission", "office", "--world", "nowhere"], 2, "there is no map 'nowhere'"),
            (["--mission", "office", "--robots", "99"], 2, "99 robots"),
            (["--mission", "{tmp}/broken.phxm"], 1, ""),
            (["--mission", "office", "--world", "{tmp}/empty.yaml"], 2, "0 walls"),
        ],
    )
    def test_what_cannot_be_run_is_said_in_a_line(self, tmp_path, arguments, code, said, capsys):
        (tmp_path / "broken.phxm").write_bytes(b"PHXM\x01nonsense")
        (tmp_path / "empty.yaml").write_text("size: [40, 40]\nstart_pose: [3.0, 1.5, 1.57]\n")
        assert run_command(["up", *(word.format(tmp=tmp_path) for word in arguments)]) == code
        told = capsys.readouterr().err
        errors = [line for line in told.splitlines() if line.startswith("phalanx: error: ")]
        assert len(errors) == 1
        assert said in errors[0]
        assert "Traceback" not in told


async def eventually_async(condition, timeout_s):
    deadline = time.monotonic() + timeout_s
    while not await condition():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.1)


@pytest.fixture
def ed25519_files(tmp_path):
    mine, other = Ed25519PrivateKey.generate(), Ed25519PrivateKey.generate()
    (built,) = build(plain_of(), BuildOptions(), os.urandom)
    path = tmp_path / "through.phxm"
    path.write_bytes(sign(built.mission, mine).encode())
    path.with_name("through.phxm.key").write_bytes(built.key.encode())
    (tmp_path / "small.yaml").write_text(SMALL)
    return public_key(mine).hex(), public_key(other).hex(), path
