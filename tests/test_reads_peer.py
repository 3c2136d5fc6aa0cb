"""Bytes from a peer that lead a kernel outside an array are rejected and logged; nothing ends, compiled and not."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from phalanx.bti import request
from phalanx.bti.refusal import Refusal
from phalanx.errors import Defective, KernelDefect, PeerError
from phalanx.kernel import PURE, reading_peer
from phalanx.pool import NO_ROW
from phalanx.robot import handlers
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import put_u16
from phalanx.world.scenarios.run import Run

VICTIM, PEER = 0, 2  # a robot's index, and the id of its peer


@pytest.fixture
def world():
    run = Run(Scenario(robots=4, duration_s=4.0))
    run.advance(1.0)
    return run.world


def fragment(world):
    """Return the first of two fragments of a request, and damage the place where its row is remembered."""
    packet = np.zeros(world.fleet.settings[0].packet_max, np.uint8)
    request.audit_head(packet, PEER, VICTIM + 1, request.FRAGMENT)
    put_u16(packet, request.AT_REQUEST, 1)
    packet[request.AT_INDEX], packet[request.AT_COUNT] = 0, 2
    place = world.fleet.rx_info[VICTIM, 0]
    place.src, place.no, place.count, place.row = PEER, 1, 2, 1 << 40
    return packet


def test_a_frame_that_leads_outside_an_array_is_rejected_and_logged(world, caplog, kernel_defects):
    packet = fragment(world)
    with caplog.at_level(logging.ERROR):
        assert handlers.on_packet(world.fleet, VICTIM, world.work, 5000, packet, len(packet)) == -1
    (line,) = caplog.messages
    assert "the peer's message was rejected" in line
    assert PURE or "request.py:" in line
    kernel_defects.clear()
    world.fleet.rx_info[VICTIM, 0].row = NO_ROW
    world.fleet.rx_info[VICTIM, 0].src = 0
    assert handlers.on_packet(world.fleet, VICTIM, world.work, 5000, packet, len(packet)) == handlers.NOTHING


def test_an_audit_that_leads_outside_an_array_gives_no_token(world, caplog, kernel_defects):
    world.fleet.rx_info[VICTIM, 0].row = -7 if not PURE else 1 << 40
    assert handlers.audit_request(world.fleet, VICTIM, world.work, 0, PEER) == Refusal.DEFECT
    assert "rejected" in caplog.text
    kernel_defects.clear()


@pytest.mark.skipif(PURE, reason="uncompiled, Python raises IndexError")
def test_elsewhere_it_is_an_error_with_file_and_line(world):
    with pytest.raises(KernelDefect, match=r"request\.py:\d+: index \d+ is outside"):
        packet = fragment(world)
        request.take_fragment(world.fleet, VICTIM, packet, len(packet), 5000)


@pytest.mark.skipif(PURE, reason="uncompiled, Python raises IndexError")
def test_what_reads_a_peers_bytes_in_python_rejects_them_too(world, caplog, kernel_defects):
    with pytest.raises(Defective, match=r"request\.py"), reading_peer():
        packet = fragment(world)
        request.take_fragment(world.fleet, VICTIM, packet, len(packet), 5000)
    assert issubclass(Defective, PeerError)
    assert "rejected" in caplog.text
    kernel_defects.clear()


def test_uncompiled_it_is_the_same():
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__, "-k", "not uncompiled"]
    env = os.environ | {"PHALANX_PURE": "1"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False, cwd=Path(__file__).parent)
    assert "2 passed, 2 skipped" in done.stdout, done.stdout
