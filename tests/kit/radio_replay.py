"""Plays the scenarios of tests/data/radio: state broadcasts every 1.5 s, and audits of 3.5 kB to four neighbours.

As in the ns-3 runs: each robot's phase is drawn once and kept; every 4 s a robot sends four messages of 3500 bytes to
four robots in range, and whoever has a whole message sends back a small reply.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phalanx.config.radio import RadioConfig
from phalanx.world.audited.events import make_queue, next_us, pop, push, refused
from phalanx.world.radio import channel as radio
from phalanx.world.radio.channel import ATTEMPT, BROADCAST, TX_END, attempt, enqueue, finish, make_air
from phalanx.world.radio.reach import in_range, make_reach, rebuild

STATE, AUDIT = 10, 11
STATE_US, AUDIT_US = 1_500_000, 4_000_000
STATE_BYTES, REPLY_BYTES = 27, 40
MESSAGE_BYTES, TARGETS = 3500, 4
REPLY = 2
NOT_THERE = -2


class Result(NamedTuple):
    broadcast: float
    broadcast_ms: float
    unicast: float
    unicast_ms: float
    airtime_share: float
    events: int
    air: radio.Air


def run(air, reach, queue, until_us, fragment_bytes, fragments, targets, left_over, receivers):
    """Handle events until then, and return how many. left_over: (N,), fragments a robot has still to hand to its NIC."""
    packet = np.zeros(8192, np.uint8)
    targets, left_over = targets.tolist(), left_over.tolist()
    per_round = [fragments * sum(target >= 0 for target in row) for row in targets]
    events = 0
    while next_us(queue) < until_us:
        now_us, kind, robot, arg = pop(queue)
        events += 1
        hand_over = radio.NOBODY
        if kind == ATTEMPT:
            attempt(air, reach, queue, robot, now_us)
        elif kind == TX_END:
            end = finish(air, reach, queue, robot, arg, now_us, receivers)
            if end.receivers == 1 and end.packet[0] == 0x80 and end.packet[1] == fragments - 1:
                packet[0], packet[1] = 0x80, REPLY
                sender = (int(end.packet[2]) << 8) + int(end.packet[3])
                enqueue(air, queue, receivers[0], packet, REPLY_BYTES, sender, now_us)
            hand_over = end.left
        elif kind == STATE:
            packet[0] = 1
            enqueue(air, queue, robot, packet, STATE_BYTES, BROADCAST, now_us)
            push(queue, now_us + STATE_US, STATE, robot, 0)
        else:
            left_over[robot] += per_round[robot]
            hand_over = robot
            push(queue, now_us + AUDIT_US, AUDIT, robot, 0)
        if hand_over != radio.NOBODY and left_over[hand_over] > 0:
            of_round = per_round[hand_over]
            nth = of_round - 1 - (left_over[hand_over] - 1) % of_round
            target = targets[hand_over][nth // fragments]
            packet[0], packet[1], packet[2], packet[3] = 0x80, nth % fragments, hand_over >> 8, hand_over & 255
            if enqueue(air, queue, hand_over, packet, fragment_bytes, target, now_us) == 0:
                left_over[hand_over] -= 1
    return events


def grid(robots: int, spacing_m: float) -> np.ndarray:
    side = round(robots**0.5)
    return np.array([(i % side * spacing_m, i // side * spacing_m) for i in range(robots)], np.float64)


def replay(robots, spacing_m, *, seconds, jitter_s=1.5, audits=False, fragments=1, seed=1, pos=None) -> Result:
    """One run; fragments: 1 as ns-3 aggregates a message, 2 as a NIC of 2 kB must send it."""
    config = RadioConfig(long_bytes=MESSAGE_BYTES // fragments)
    rng = np.random.default_rng(seed)
    pos = grid(robots, spacing_m) if pos is None else pos
    air, queue = make_air(robots, config, seed), make_queue(6 * robots)
    reach = make_reach(robots, config.range_m)
    assert rebuild(reach, pos) <= len(reach.candidate_ids)
    targets = np.full((robots, TARGETS), NOT_THERE, np.int32)  # a corner has three neighbours
    for i in range(robots):
        near = reach.ids[reach.near[i] : in_range(reach, i)]
        chosen = rng.permutation(near)[:TARGETS]
        targets[i, : len(chosen)] = chosen
        push(queue, int(rng.uniform(0, jitter_s * 1e6)), STATE, i, 0)
        if audits:
            push(queue, int(rng.uniform(0, AUDIT_US)), AUDIT, i, 0)
    receivers = np.zeros(robots, np.int32)
    left_over = np.zeros(robots, np.int64)
    fragment = MESSAGE_BYTES // fragments
    events = run(air, reach, queue, int(seconds * 1e6), fragment, fragments, targets, left_over, receivers)
    assert refused(queue) == 0
    of = air.counts.sum(axis=0)
    app, audit = of[radio.APP_BROADCAST], of[radio.AUDIT_UNICAST]
    return Result(
        broadcast=radio.delivery(air, radio.APP_BROADCAST),
        broadcast_ms=app[radio.DELAY_US] / max(1, app[radio.ARRIVED]) / 1000,
        unicast=radio.delivery(air, radio.AUDIT_UNICAST),
        unicast_ms=audit[radio.DELAY_US] / max(1, audit[radio.ARRIVED]) / 1000,
        airtime_share=of[:, radio.AIRTIME_US].sum() / seconds / 1e6,
        events=events,
        air=air,
    )
