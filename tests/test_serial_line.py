"""The serial line: frames that rubbish cannot take along, calls that are done once, and a limit on how long each takes."""

from __future__ import annotations

import json
import os
import random
import signal
import threading
import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import boards
from phalanx.bti.nodes import Limits, Refused
from phalanx.errors import Unavailable, UsageError
from phalanx.net.serial_line import SerialLine, open_line
from phalanx.net.serial_node import SerialNode
from phalanx.wire import lines
from phalanx.wire.framing import Frames, encode_frame
from serial_keys import LIMITS, MASTER, sealed

CASES = json.loads((boards.ROOT / "vectors" / "serial.json").read_text())["cases"]
LONGEST = 2052
PAYLOADS = st.binary(min_size=3, max_size=600) | st.integers(3, LONGEST).map(lambda n: b"\1" * n)


def keyed(flash, *words, **said):
    board = boards.process(flash, *words, **said)
    board.make(LIMITS)
    board.load_master(MASTER, 7)
    board.load_mission(0, sealed(1))
    return board


class TestFrames:
    @pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
    @pytest.mark.parametrize("piece", [1, 7, 10_000])
    def test_streams_have_the_payloads_that_c_finds_in_them(self, case, piece):
        stream, frames = bytes.fromhex(case["stream"]), Frames(LONGEST)
        found = [p for at in range(0, len(stream), piece) for p in frames.feed(stream[at : at + piece])]
        assert [payload.hex() for payload in found] == case["payloads"]
        if stream.count(0) == 2 and stream[:1] == stream[-1:] == b"\0":
            assert encode_frame(found[0]).hex() == case["stream"]

    @settings(deadline=None, max_examples=25)
    @given(payloads=st.lists(PAYLOADS, max_size=4), rubbish=st.lists(st.binary(max_size=40), min_size=5, max_size=5))
    def test_rubbish_between_frames_costs_none_of_them(self, payloads, rubbish):
        stream = rubbish[4] + b"".join(encode_frame(p) + r for p, r in zip(payloads, rubbish, strict=False))
        assert [p for p in Frames(LONGEST).feed(stream) if p in payloads] == payloads

    @settings(deadline=None, max_examples=25)
    @given(st.lists(PAYLOADS, min_size=3, max_size=3), st.binary(min_size=1, max_size=30), st.data())
    def test_rubbish_inside_a_frame_costs_that_one_alone(self, payloads, rubbish, data):
        first, second, third = map(encode_frame, payloads)
        at = data.draw(st.integers(1, len(second) - 1))
        cut = data.draw(st.integers(at, len(second)))
        found = list(Frames(LONGEST).feed(first + second[:at] + rubbish + second[cut:] + third))
        assert found[0] == payloads[0]
        assert found[-1] == payloads[2]

    @given(st.binary(max_size=3000))
    def test_whatever_comes_is_survived_and_no_more_is_kept_than_a_frame(self, raw):
        frames = Frames(20)
        assert all(len(p) <= 20 for p in frames.feed(raw))
        assert len(frames._rest) <= 40


class TestTable:
    def test_limits_are_those_of_the_nodes_in_their_order(self):
        assert [field.name for field in lines.LIMITS.fields[1:]] == list(Limits.__dataclass_fields__)

    def test_tags_of_calls_have_no_gap_since_c_looks_their_sizes_up(self):
        assert [call.tag for call in lines.CALLS] == list(range(lines.HELLO.tag, lines.HELLO.tag + len(lines.CALLS)))


class TestBoard:
    def test_it_answers_as_the_oracle_does(self, tmp_path):
        for robot in range(4):
            flash = tmp_path / str(robot)
            made = [boards.process(flash, "told")]

            def again(made=made, flash=flash):
                made[-1].close()
                made.append(boards.process(flash, "told"))
                return made[-1]

            assert boards.live(robot, made[0], again) > 50
            made[-1].close()

    def test_a_new_board_takes_no_key_and_forwards_nothing_before_its_limits(self, tmp_path):
        board = boards.process(tmp_path / "flash")
        assert board.about == type(board.about)(told=lines.TOLD_READINGS, robot_id=0, seq=0)
        with pytest.raises(Refused, match="arg"):
            board.load_master(MASTER, 7)
        assert board.ask(lines.SEND, packet=b"\1hello")[0] == boards.CODES["NO_KEY"]
        board.make(LIMITS)
        with pytest.raises(Refused, match="arg"):
            board.make(replace(LIMITS, t_val_ms=0))
        board.load_master(MASTER, 7)  # limits that were refused take nothing away
        with pytest.raises(Refused, match="seq"):
            board.make(LIMITS)
        board.close()

    def test_nobody_tells_a_robot_the_time(self, tmp_path):
        board = boards.process(tmp_path / "flash")
        with pytest.raises(Unavailable, match="does not know this call"):
            board._call(lines.CLOCK, t=5)

    def test_a_time_before_the_last_is_refused(self, tmp_path):
        board = keyed(tmp_path / "flash", "told")
        assert board.ask(lines.CHECK, 500) == (0, b"")
        with pytest.raises(Unavailable, match="refuses the time"):
            board.ask(lines.CHECK, 499)

    def test_what_was_said_is_said_again_and_not_done_again(self, tmp_path):
        """The first answer to each call is lost, and a third of all bytes to the board are followed by rubbish."""
        calm = keyed(tmp_path / "calm", "told")
        board = keyed(tmp_path / "flash", "told", again_s=0.05)
        line, receive, send = board._line, board._line.receive, board._line.send
        chance, deaf = random.Random(4), []

        def lossy(until_s):
            raw = receive(until_s)
            if raw and board._number not in deaf:
                deaf.append(board._number)
                return b""
            return raw

        def noisy(raw, until_s):
            send(chance.randbytes(chance.randrange(12)) + raw + chance.randbytes(chance.randrange(12)), until_s)

        line.receive, line.send = lossy, noisy
        for k in range(12):
            frame = bytes([1, k]) * 20
            assert board.ask(lines.RECV, 100 + k, packet=frame) == calm.ask(lines.RECV, 100 + k, packet=frame)
        asked = {"now_ms": 200, "auditor": 3}
        assert board.ask(lines.TOKEN_REQUEST, **asked) == calm.ask(lines.TOKEN_REQUEST, **asked)
        assert board.again >= 13
        board.close()
        calm.close()

    @settings(deadline=None, max_examples=25)
    @given(st.binary(max_size=400), st.binary(max_size=60))
    def test_rubbish_locks_nothing_up(self, process_board, rubbish, more):
        board = process_board
        board._line.send(
            rubbish + b"\0" + encode_frame(more) + encode_frame(bytes([0x5F]) + more), time.monotonic() + 60
        )
        code, about = board._call(lines.HELLO, version=lines.VERSION)
        assert code == 0
        assert about[:1] == bytes([lines.VERSION])
        assert board.ask(lines.POLL, reading=b"still here")[0] == 17

    def test_who_asks_and_does_not_listen_is_answered_once_he_does(self, tmp_path):
        """The board waits for room for its answers, and the c-node for room for more calls."""
        board = keyed(tmp_path / "flash")
        calls = b"".join(encode_frame(lines.RECV.encode(number=900 + k, packet=bytes(2000))) for k in range(2000))
        with pytest.raises(BlockingIOError):
            while True:
                os.write(board._line._fd, calls)
        assert board.ask(lines.POLL, reading=b"x")[0] == 8
        board.close()


@pytest.fixture(scope="module")
def process_board(tmp_path_factory):
    board = keyed(tmp_path_factory.mktemp("board") / "flash")
    yield board
    board.close()


class TestLimit:
    def test_a_call_that_is_not_answered_is_one_clear_error_and_so_is_every_one_after_it(self, tmp_path):
        board = keyed(tmp_path / "flash")
        board._timeout_s, board._again_s = 0.3, 0.05
        os.kill(board._line.process.pid, signal.SIGSTOP)
        with pytest.raises(Unavailable, match=r"did not answer call_poll within 0\.3 s$"):
            board.ask(lines.POLL, reading=b"x")
        with pytest.raises(Unavailable, match=r"did not answer call_poll within 0\.3 s$"):
            board.ask(lines.SEND, packet=b"\1x")

    def test_who_says_nothing_but_rubbish_has_not_answered(self, monkeypatch):
        monkeypatch.setattr("phalanx.net.serial_node.BEGINS_TIMEOUT_S", 0.2)

        class Rubbish(SerialLine):
            def __init__(self):
                self.where, self.process, self.byte_s = "there", None, 0.0

            def send(self, raw, until_s):
                pass

            def receive(self, until_s):
                time.sleep(0.01)
                return b"\x05rubbish\0" * 50

            def close(self):
                pass

        with pytest.raises(Unavailable, match="there did not answer call_hello"):
            SerialNode(Rubbish(), timeout_s=0.2)

    def test_a_board_that_is_gone_is_told_at_once(self, tmp_path):
        board = keyed(tmp_path / "flash")
        board._line.process.kill()
        board._line.process.wait()
        with pytest.raises(Unavailable, match="has closed the line"):
            board.ask(lines.POLL, reading=b"x")

    def test_another_version_is_refused_by_both(self, tmp_path, monkeypatch):
        monkeypatch.setattr(lines, "VERSION", 2)
        with pytest.raises(Unavailable, match="has version 1 of the serial protocol, not 2"):
            boards.process(tmp_path / "flash")
        monkeypatch.undo()
        board = keyed(tmp_path / "flash-2")
        board._call(lines.HELLO, version=2)
        with pytest.raises(Unavailable, match="lost power"):
            board.ask(lines.POLL, reading=b"x")

    @pytest.mark.parametrize("where", ["usb:7", "tcp:127.0.0.1:http", "serial:/dev/null@12"])
    def test_a_line_of_no_kind_is_a_misuse(self, where):
        with pytest.raises(UsageError) as error:
            open_line(where)
        assert "\n" not in str(error.value)

    @pytest.mark.parametrize("where", ["unix:/nowhere/socket", "serial:/dev/null", "process:/nowhere/node,flash"])
    def test_a_line_that_is_not_there_is_one_clear_error(self, where, monkeypatch):
        monkeypatch.setattr("phalanx.net.serial_line.OPEN_TIMEOUT_S", 0.1)
        with pytest.raises(Unavailable, match="cannot be opened"):
            open_line(where)


class TestPower:
    def test_a_board_that_lost_power_has_lost_its_mission_and_says_so(self, tmp_path):
        board = keyed(tmp_path / "flash")
        board.close()
        again = boards.process(tmp_path / "flash")
        assert (again.about.robot_id, again.about.seq) == (7, 1)
        assert again.ask(lines.SEND, packet=b"\1x")[0] == boards.CODES["NO_KEY"]
        with pytest.raises(Refused, match="seq"):
            again.load_mission(0, sealed(1))
        again.load_mission(0, sealed(2))
        again.close()

    def test_killed_at_any_moment_no_mission_number_is_taken_twice(self, tmp_path):
        """Of the bytes that are kept port/line.c tries each; here a real process and a real file."""
        chance, answered = random.Random(1), 0
        board = keyed(tmp_path / "flash")
        board.close()
        for seq in range(2, 25):
            board = boards.process(tmp_path / "flash")
            assert board.about.seq >= answered
            pid = board._line.process.pid
            killer = threading.Timer(chance.random() * 0.002, os.kill, (pid, signal.SIGKILL))
            killer.start()
            try:
                board.load_mission(0, sealed(seq))
                answered = seq
            except Refused:
                raise AssertionError(f"number {seq} was refused: it was never used") from None
            except Unavailable:
                pass
            killer.join()
            board.close()
        last = boards.process(tmp_path / "flash")
        last.load_mission(0, sealed(25))
        with pytest.raises(Refused, match="seq"):
            last.load_mission(0, sealed(max(answered, 1)))  # on a busy machine none may have been in time
        last.close()
