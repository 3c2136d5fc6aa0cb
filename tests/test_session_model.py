"""Have spin search all runs of `model/session.pml` for one that breaks a claim. Each form that is broken on purpose must."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

MODEL = Path(__file__).parent / "model" / "session.pml"
DEEP = 1_000_000  # steps of the longest run that is followed
CLAIMS = {"record": "RECORD", "acknowledged": "REMOVED", "<=1": "ONE", "before": "REPLAY", "kept": "KEPT"}
BROKEN = {
    "FORGED": "RECORD",
    "NO_RECHECK -DNOT_KEPT": "REMOVED",
    "ACK_FIRST": "REMOVED",
    "TICKET_LIVES": "REMOVED",
    "TWO_SESSIONS": "ONE",
    "TICKET_LATE": "REMOVED",
    "AT_HELLO": "REPLAY",
    "SECRET_DIES": "KEPT",
    "RENEWED": "KEPT",
    "SPENT": "KEPT",
    "UNSPENT": "ONE",
}


def search(folder, option="", optimised="-O1"):
    """Return the claim that a run breaks, or "", and how many states were searched."""
    define = f"-D{option}".split() if option else []
    for words in (["spin", *define, "-a", MODEL], ["gcc", optimised, "-w", "-DSAFETY", "-o", "pan", "pan.c"]):
        subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    done = subprocess.run(["./pan", f"-m{DEEP}"], cwd=folder, capture_output=True, text=True, check=True).stdout
    assert "search depth too small" not in done
    states = int(re.search(r"^ *(\d+) states, stored", done, re.MULTILINE)[1])
    violated = re.search(r"assertion violated (.*) \(at depth", done)
    if violated is None:
        assert "errors: 0" in done
        return "", states
    (claim,) = [claim for word, claim in CLAIMS.items() if word in violated[1].replace(" ", "")]
    return claim, states


def test_no_run_of_handshake_resume_and_removal_breaks_a_claim(tmp_path):
    broken, states = search(tmp_path)
    assert not broken
    assert states > 10_000


@pytest.mark.parametrize("option", BROKEN)
def test_what_is_broken_on_purpose_is_found(option, tmp_path):
    # It is found before an optimiser were done.
    assert search(tmp_path, option, "-O0")[0] == BROKEN[option]
