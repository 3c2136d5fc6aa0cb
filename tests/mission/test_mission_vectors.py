"""The vectors of encoded missions, which were packed by hand: what is written there is what this code says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from phalanx.config.mission import CodingConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.errors import PhalanxError
from phalanx.mission import (
    Action,
    Direction,
    Experience,
    Landmark,
    Profile,
    State,
    Walker,
    canonical,
    check_signature,
    parse_mission,
    parse_start_key,
)
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import AT_POSITION, Shape, place_bytes
from phalanx.mission.file.records import Header
from phalanx.mission.observable import LANDMARK_TYPES, Cell, Offset
from phalanx.mission.walk.gate import Hint

VECTORS = Path(__file__).parents[2] / "vectors"
ROWS = json.loads((VECTORS / "mission.json").read_text())


def cases(kind: str):
    return pytest.mark.parametrize("case", ROWS[kind], ids=[row["name"] for row in ROWS[kind]])


@cases("canonical")
def test_canonical_bytes_are_the_ones_written_by_hand(case):
    place = b""
    if "landmark" in case:
        words = case["landmark"]
        shape = Shape(1 + LANDMARK_TYPES.index(words["type"]), text=int("text" in words))
        cell = Cell(words["x"], words["y"], words.get("bin", -1), words.get("area", -1))
        place = place_bytes(shape, cell, words.get("text"))
    if "position" in case:
        place = place_bytes(Shape(AT_POSITION), Cell(*case["position"]))
    raw = canonical(
        place,
        sensors=[word.encode() for word in case.get("sensors", [])],
        action=Action(case["action"][0], tuple(case["action"][1].items())) if "action" in case else None,
        window=case.get("window"),
        messages=[bytes.fromhex(message) for message in case.get("messages_hex", [])],
        previous=bytes.fromhex(case["previous_hex"]) if "previous_hex" in case else None,
        direction=Direction(*case["direction"]) if "direction" in case else None,
    )
    assert (raw.hex(), sha3_256(raw).hex()) == (case["canonical_hex"], case["hash_hex"])


@cases("locks")
def test_locks_are_hkdfs_and_scrypts(case):
    header = Header(Profile.SEALED, bytes(range(16)), CodingConfig(kdf_log2_n=4), 9)
    messages = tuple(bytes.fromhex(message) for message in case["messages_hex"])
    salt = sealed.node_salt(bytes.fromhex(case["gate_hex"]), messages, header, case["node"], case["alias"])
    hint = Hint(Shape(AT_POSITION), Offset(*case["offset"]))
    mark, key = sealed.try_observation(header, bytes.fromhex(case["canonical_hex"]), hint, salt)
    assert (salt.hex(), mark.hex(), key.hex()) == (case["salt_hex"], case["mark_hex"], case["key_hex"])


def outcome(raw: bytes, *, unsigned_may_pass: bool) -> str:
    try:
        mission = parse_mission(raw)
        if mission.signer or not unsigned_may_pass:
            check_signature(mission, None)
    except PhalanxError as error:
        return type(error).__name__
    assert mission.encode() == raw
    return "ok"


@cases("cases")
def test_files_are_walked_or_refused_for_the_right_reason(case):
    raw = bytes.fromhex(case["file_hex"])
    assert outcome(raw, unsigned_may_pass=case["expect"] == "ok") == case["expect"]
    if case["expect"] != "ok":
        return
    key = parse_start_key(bytes.fromhex(case["key_hex"])) if "key_hex" in case else None
    walker, state = Walker(parse_mission(raw), key), State()
    seen = [
        Experience(0.0, 3.0, 1.5, 0.0),
        Experience(1.0, 8.0, 11.0, 0.0, 9.0, (Landmark("doorway", 9.02, 12.01, 0.28),)),
    ]
    for expected, experience in zip(case["walk"], seen, strict=False):
        state, said = walker.step(state, experience)
        assert said.decoded is not None
        if expected["landmark"] is None:
            assert said.decoded.place_m == (expected["x_m"], expected["y_m"])
        else:
            truth = said.decoded.landmark
            assert (truth.type, truth.x_m, truth.y_m) == ("doorway", pytest.approx(9.03), pytest.approx(12.0))
            assert truth.orientation_rad == pytest.approx(0.3, abs=1e-4)
            assert len(said.decoded.sends) == 1
