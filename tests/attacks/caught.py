"""Requests for audits as auditors get them: caught in a run, judged once more, compiled or not, here or in a child."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
from trials import scenario

from phalanx.bti import request
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import make_work
from phalanx.kernel import PURE
from phalanx.robot import handlers
from phalanx.world.scenarios.run import Run
from shown_requests import requests_of

HERE = Path(__file__).parent
MARKS = range(0x81, 0x84)


def length_of(q) -> int:
    """Of a well-formed request."""
    tokens, checkpoint = (
        int(q[request.AT_TOKENS]),
        int.from_bytes(q[request.AT_CHECKPOINT_LEN :][:2].tobytes(), "little"),
    )
    segment = int.from_bytes(q[request.AT_SEGMENT_LEN :][:4].tobytes(), "little")
    return request.HEAD_BYTES + tokens * request.TOKEN_BYTES + checkpoint + segment


class Caught:
    """A run's fleet, and requests made in it: (auditee, auditor, bytes), indices of robots."""

    def __init__(self, run: Run, until_s: float):
        self.requests = list(requests_of(run, until_s))
        self.judge = Judge(run.world.fleet, run.scenario.bti)


class Judge:
    """The auditors of a fleet whose robots are all alive."""

    def __init__(self, fleet, config):
        self.fleet, self.config, self.work = fleet, config, make_work(config)

    def __call__(self, auditee: int, auditor: int, q: bytes) -> tuple[int, bytes]:
        """The refusal, and the controller's state where the replay ended, nothing if it never began."""
        f, w = self.fleet, self.work
        w.state[:] = 0
        room = f.rx.rows.shape[1]
        f.rx.rows[auditor] = 0xA5  # what an earlier request left
        f.rx.rows[auditor, : min(len(q), room)] = np.frombuffer(q[:room], np.uint8)
        f.rx_info[auditor, 0].row, f.rx_info[auditor, 0].len = auditor, min(len(q), room)
        refused = int(handlers.precheck_request(f, auditor, w, 0, auditee + 1))
        if not refused:
            refused = int(handlers.audit_request(f, auditor, w, 0, auditee + 1))
        replayed = refused == 0 or refused >= Refusal.STATE_MALFORMED
        return refused, w.state.tobytes() if replayed else b""

    def elsewhere(self, requests: list[tuple[int, int, bytes]], tmp_path: Path) -> list[tuple[int, str]]:
        """The same verdicts from another process, in which nothing is compiled; the states as hex."""
        path = tmp_path / "requests.pickle"
        arrays = {name: getattr(self.fleet, name) for name in Fleet._fields}
        path.write_bytes(pickle.dumps((arrays, self.config, requests)))
        child = subprocess.run(
            [sys.executable, str(HERE / "caught.py"), str(path)],
            env=os.environ | {"PHALANX_PURE": "1", "PYTHONWARNINGS": "error", "PYTHONPATH": str(HERE.parent / "kit")},
            capture_output=True,
            text=True,
        )
        assert child.returncode == 0, child.stderr
        return [tuple(verdict) for verdict in json.loads(child.stdout)]


def meaning(q: bytes) -> tuple[bytes, list[bytes], list[bytes]]:
    """What a request says, without what says nothing: where chains were flushed, and the a-node's authenticator.

    Two requests with the same meaning may both pass. The order of entries of different chains is theirs to choose.
    """
    head = bytearray(q)
    head[request.AT_AUTH_A : request.AT_AUTH_A + 8] = bytes(8)
    head[request.AT_SEGMENT_LEN : request.AT_SEGMENT_LEN + 4] = bytes(4)
    at = length_of(np.frombuffer(q, np.uint8)) - int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little")
    before, chains = bytes(head[:at]), ([], [])
    while at < len(q):
        size = 1 if q[at] in MARKS else 7 + int.from_bytes(q[at + 5 : at + 7], "little")
        if size > 1:
            chains[q[at] == 1].append(q[at : at + size])
        at += size
    return before, *chains


def quiet_run(defence: str, until_s: float, robots: int = 10, seed: int = 3) -> Caught:
    """Nobody lies."""
    return Caught(Run(scenario(defence, robots=robots, seed=seed)), until_s)


if __name__ == "__main__":
    assert PURE, "compiled"
    arrays, config, asked = pickle.loads(Path(sys.argv[1]).read_bytes())
    judge = Judge(Fleet(**arrays), config)
    print(json.dumps([(refused, state.hex()) for refused, state in (judge(*each) for each in asked)]))
