"""What cannot read the byte table, being below it, or draws on it by several records, agrees with it."""

from __future__ import annotations

from phalanx.config import bti
from phalanx.robot.controllers import orders, wheels
from phalanx.wire import table


def test_the_sizes_that_config_repeats_are_the_tables():
    assert table.AUDIT_FRAGMENT.size == bti.FRAGMENT_HEAD_BYTES
    assert table.ENTRY_HEADER_BYTES + table.STATE.size == bti.STATE_ENTRY_BYTES
    assert bti.BtiConfig().frame_max_bytes == table.FRAME_MAX


def test_a_kind_of_frame_reading_or_command_is_one_records():
    kinds = [record.tag for record in table.PAYLOADS if record.tag != table.KIND_AUDIT]
    assert len(set(kinds)) == len(kinds)
    assert not any(kind & table.KIND_AUDIT for kind in kinds), "they are chained"


def test_records_that_are_read_by_the_same_offsets_have_them():
    for field in ("id", "t"):
        assert len({record.offset(field) for record in (table.STATE, table.SENSOR, table.ACCELERATION)}) == 1
        assert len({r.offset(field) for r in (table.WHEELS_STATE, table.WHEELS_SENSOR, table.WHEELS_COMMAND)}) == 1
    poses = {table.WHEELS_STATE.offset("x_mm"), table.WHEELS_SENSOR.offset("x_mm")}
    assert poses == {table.WHEELS_COMMAND.offset("left")} == {wheels.BODY}


def test_an_order_is_the_tables_record():
    told = table.ORDER.decode(orders.wheels_order(7, 3, -100, 50))
    assert told == {"id": 7, "number": 3, "action": orders.WHEELS, "body": b"\x9c\x32"}
