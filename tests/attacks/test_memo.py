"""What has passed an audit once passes again, and nothing else does: with the memo, verdicts are those without."""

from __future__ import annotations

import numpy as np
import pytest
from caught import quiet_run
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.bti import request
from phalanx.bti.fleet import HARDENED, PAPER
from phalanx.bti.refusal import Refusal

RUNS = {"hardened": HARDENED, "paper": PAPER}


@pytest.fixture(scope="module", params=RUNS)
def caught(request):
    return quiet_run(request.param, 12.0, robots=6)


def forget(judge):
    judge.fleet.memo.passed[:] = np.zeros((), judge.fleet.memo.passed.dtype)


def plainly(judge, *asked):
    """The verdict by an auditor that remembers nothing, and afterwards as much as before."""
    kept = judge.fleet.memo.passed.copy()
    forget(judge)
    verdict = judge(*asked)
    judge.fleet.memo.passed[:] = kept
    return verdict


def grown(caught):
    """Pairs of requests of one robot, the second the same and more."""
    for auditee, _, q in caught.requests:
        for other, auditor, longer in caught.requests:
            begins = longer[request.HEAD_BYTES :].startswith(q[request.HEAD_BYTES :])
            if other == auditee and len(longer) > len(q) and begins:
                yield auditee, auditor, q, longer


def test_a_request_again_is_known_whole(caught):
    judge = caught.judge
    forget(judge)
    for auditee, auditor, q in caught.requests:
        first = judge(auditee, auditor, q)
        assert first[0] == Refusal.NONE
        assert int(judge.work.case[0].known) < len(q)
        assert judge(auditee, auditor, q) == first
        assert int(judge.work.case[0].known) == len(q)


@settings(max_examples=150)
@given(st.data())
def test_an_altered_request_is_judged_as_if_nothing_was_known(caught, data):
    judge = caught.judge
    auditee, auditor, q = data.draw(st.sampled_from(caught.requests))
    forget(judge)
    assert judge(auditee, auditor, q)[0] == Refusal.NONE
    altered = bytearray(q)
    for at in data.draw(st.lists(st.integers(0, len(q) - 1), min_size=1, max_size=3)):
        altered[at] ^= 1 << data.draw(st.integers(0, 7))
    # The head says how long the parts are: their sum must stay what it was, or nothing is looked at.
    cut = data.draw(st.integers(0, 40))
    shown = bytes(altered[: len(altered) - cut])
    told = judge(auditee, auditor, shown)
    assert told == plainly(judge, auditee, auditor, shown)
    # What was refused has not become what is known.
    assert judge(auditee, auditor, q) == plainly(judge, auditee, auditor, q)


def test_who_shows_less_at_an_earlier_time_is_not_known(caught):
    """A later request's entries may lie in the future of an earlier one."""
    judge = caught.judge
    auditee, auditor, q = caught.requests[-1]
    forget(judge)
    judge(auditee, auditor, q)
    judge.fleet.memo.passed["t"] += 1
    judge(auditee, auditor, q)
    assert int(judge.work.case[0].known) == 0


def test_a_log_that_ends_behind_an_entry_is_not_remembered(caught):
    """Evidence for the entry might follow, and call for other outputs."""
    judge = caught.judge
    auditee, auditor, q = caught.requests[-1]
    forget(judge)
    judge(auditee, auditor, q)
    assert judge.fleet.memo.passed["end"].tolist().count(len(q)) == 1
    assert q[-1] & 0x80  # as honest robots' logs end: with the marks of the flush for this request
