"""What cannot read the byte table, being below it, or draws on it by several records, agrees with it."""

from __future__ import annotations

import ordered
from phalanx.config import bti, flock
from phalanx.robot.controllers.bundled import wheels
from phalanx.wire import driven, table


def test_the_sizes_that_config_repeats_are_the_tables():
    assert table.AUDIT_FRAGMENT.size == bti.FRAGMENT_HEAD_BYTES
    assert table.ENTRY_HEADER_BYTES + table.STATE.size == bti.STATE_ENTRY_BYTES
    assert bti.ENTRY_HEAD_BYTES == table.ENTRY_HEADER_BYTES
    assert table.CHECKPOINT.size + table.FLOCK_MEMORY.size == bti.CHECKPOINT_BYTES
    assert bti.NEIGHBOUR_BYTES == table.NEIGHBOUR.size
    assert bti.BtiConfig().packet_max_bytes == table.PACKET_MAX


def collisions(records) -> list[set[str]]:
    """Names of records that begin with the same byte, where that byte says which it is."""
    named: dict[int, set[str]] = {}
    for record in records:
        if record.tag is not None:
            named.setdefault(record.tag, set()).add(record.name)
    return [names for names in named.values() if len(names) > 1]


def test_a_first_byte_is_one_records():
    audits = [{record.name for record in table.PAYLOADS if record.tag == table.KIND_AUDIT}]
    assert collisions(table.PAYLOADS) == audits, "these are told apart by `sub`"
    assert len({field.value for r in table.PAYLOADS for field in r.fields if field.name == "sub"}) == len(audits[0])
    profiles = [{"auth_s", "auth_s_paper"}, {"treq", "treq_paper"}]
    assert collisions(table.MACED) == profiles, "a node knows one of each"
    assert collisions(table.LOGGED) == []
    entries = {table.ENTRY_INPUT, table.ENTRY_RECV, table.ENTRY_SEND, table.ENTRY_ACMD}
    assert not entries & {record.tag for record in (*table.LOGGED, *table.MACED)}


def test_two_records_of_one_kind_are_found():
    twin = table.record("twin", tag=table.KIND_DRIVE)
    assert collisions((*table.ON_MISSION, twin)) == [{"drive", "twin"}]


def test_a_records_name_is_its_own():
    assert len({record.name for record in table.RECORDS}) == len(table.RECORDS)


def test_only_frames_of_the_audits_and_marks_have_their_bit():
    kinds = [record.tag for record in table.PAYLOADS if record.tag not in (None, table.KIND_AUDIT)]
    assert not any(kind & table.KIND_AUDIT for kind in kinds), "they are chained"
    assert all(record.tag & table.MARK for record in table.LOGGED), "they are not"


def test_records_that_are_read_by_the_same_offsets_have_them():
    for field in ("id", "t"):
        assert len({record.at(field) for record in (table.STATE, table.SENSOR, table.ACCELERATION)}) == 1
        assert len({r.at(field) for r in (table.WHEELS_STATE, table.WHEELS_SENSOR, table.WHEELS_COMMAND)}) == 1
    poses = {table.WHEELS_STATE.at("x_mm"), table.WHEELS_SENSOR.at("x_mm")}
    assert poses == {table.WHEELS_COMMAND.at("left")} == {wheels.BODY}


def test_what_is_copied_from_one_record_to_another_lies_in_both_alike():
    def layout(record, first):
        names = [field.name for field in record.fields]
        return [(f.name, f.type) for f in record.fields[names.index(first) :]][:4]

    assert layout(table.STATE, "x_m") == layout(table.SENSOR, "x_m") == layout(table.NEIGHBOUR, "x_m")
    assert layout(table.STATE, "x_m") == layout(table.FLOCK_MEMORY, "x_m")
    assert table.REQUEST.at("t") + table.TOKEN_REQUEST.size == table.REQUEST.at("top_s")
    assert table.REQUEST.at("treq_mac") - table.REQUEST.at("t") == table.TOKEN_REQUEST.at("mac")


def test_an_order_is_the_tables_record_and_ends_in_its_signature():
    frame = ordered.signer().wheels(3, 1234, -100, 50)
    told = driven.ORDER.decode(frame)
    assert told.pop("body") == b"\x9c\x32" + frame[-driven.SIGNATURE_BYTES :]
    whose = {"mission": ordered.MISSION, "signer": driven.GATEWAY}
    assert told == {**whose, "number": 1, "said": 1234, "id": 3, "action": driven.TELL_WHEELS}


def test_a_driven_robot_remembers_a_signer_for_each_key_that_its_mission_names():
    (signers,) = (field for field in driven.WHEELS_MEMORY.fields if field.name == "signers")
    assert signers.size == driven.SIGNERS * driven.SIGNER.size
    assert driven.SIGNER.fields[0].size == driven.SIGNER_KEY_BYTES == flock.KEY_BYTES
