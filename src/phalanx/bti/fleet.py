"""State of N c-nodes as arrays with one row per robot; kernels take them and a robot's index.

This state is untrusted, except the trusted nodes' memory in `snode` and `anode`, which only the C in firmware/ reads.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x1, I64x2, Records, U8x2, U8x3, U16x2, layout
from phalanx.bundle import bundled
from phalanx.config import BtiConfig
from phalanx.pool import NO_ROW, PAGE_BYTES, Pool, lines, make_pool, sparse
from phalanx.wire import table
from phalanx.wire.table import HASH_BYTES, MAC_BYTES

from .memo import Memo, make_memo

# The firmware's profiles, and PLAIN: robots without trusted nodes, whose entries are not chained or logged.
HARDENED, PAPER, PLAIN = 0, 1, 2
# Requests that are assembled from fragments at the same time, beside one of each of f_max compromised robots, so that
# these cannot displace others (docs/adr/0014).
RX_SLOTS = 3
PAPER_ROOM = 6  # logs in `paper` are larger by this factor
START, PENDING = 0, 1
LONG_AGO = -(1 << 40)
# If all logs would take more than LARGE_LOGS_BYTES, the first LOG_FRONT_BYTES of each are stored densely, and the rest
# sparsely. With ten neighbours few logs are longer than that, with 24 most.
LARGE_LOGS_BYTES, LOG_FRONT_BYTES = 8 << 20, 2688

ROBOT = layout(
    "id u2",
    "alive u1",  # powered and keyed
    "log_full u1",
    # Fields of every event are adjacent: in large swarms each cache line of them is a miss.
    "booted u1",  # the log begins at boot, not at a checkpoint
    "seeks u1",  # 0 if it does not seek, else 1 + its SEEKs in this round, at most MOST_DOUBLED
    "log_len i8",
    "log_max i8",  # longest log so far
    "state_len i8",
    "step i8",  # INPUTs so far
    "peers i8",
    "t_key i8",  # ms of the robot's own clock, at which its mission key was loaded
    "phase i8",  # ms; its sensors' grid is t_key + phase + k * t_control
    "checkpoint_no i8",  # number of the last checkpoint
    "start_no i8",  # number of the checkpoint at which the log begins
    "checkpoint_at i8",  # offset of the pending checkpoint's mark in the log, -1 if there is none
    "start_len i8",  # length of the log's start: a checkpoint, or the record `booted`
    "pending_len i8",
    "round_no i8",  # not `round`: numpy records have a method of that name
    "quota i8",  # requests that may still be sent before the next retry
    "got i8",  # tokens received in this round
    "asked_at i8",
    "request_no request_to u2",
    "request_len i8",  # length of the request that is being sent, 0 if none
    "request_row i4",  # its row in `Fleet.request`, or NO_ROW
    "nonce u4",  # of this round's SEEK; drawn from the secret
    f"secret {MAC_BYTES}u1",  # MAC of an authenticator that is never sent: the source of all random times
    "round_at i8",  # when this round began
    "drawn_in i8",  # one more than the round for which nonce and secret were drawn
    "seek_at i8",  # when it sends the next SEEK, ms of the robot's clock
    "retry_at i8",  # when further robots may be asked
    "answer_at i8",  # when it answers the next SEEK; 0: no SEEK is unanswered
    "request_next i8",  # index of the request's next fragment
    "repeats i8",  # number of repeated fragments of the request
    "repeat_at i8",  # when the next fragment may be sent, ms of the robot's clock
    "tokens_start tokens_pending i8",
    "accepted i8",  # requests accepted for audit since boot
    "requests_sent tokens_got audits_passed audits_refused i8",
)
TOKEN = layout("auditor t i8", f"mac {MAC_BYTES}u1")
PEER = layout(
    "heard i8",  # ms of our clock, of the newest AUDIT packet from it
    "token i8",  # t of its newest token
    "asked_ms i8",  # when we last asked it
    "took i8",  # ms at which we last accepted the begin of its request
    "took_t i8",  # time of its last accepted token request, on its own clock
    "here i8",  # ms at which it last answered our SEEK
    "asked i4",  # round in which we last asked it
    "claimed i4",  # number of the checkpoint in that request
    "answered i4",  # round in which it last gave us a token
    "misses i4",  # consecutive rounds in which it did not answer our request
)
# Pending answer to a peer's SEEK, and the last token issued to that peer.
OWED = layout(
    "sought i8",  # ms of our clock, of its last SEEK that we accepted
    "answer_at i8",  # when to answer it; 0: already answered
    "nonce since i8",  # from that SEEK
    "t i8",  # time of its last request that passed; then the token's MAC and the request's number
    f"mac {MAC_BYTES}u1",
    "no i8",
)
RX = layout(
    "src i8",  # sender of the request; 0: this entry is free, and its row is released
    "no count have len at i8",
    "row i8",  # current or last row in `Fleet.rx`
)
SETTINGS = layout(
    "profile controller f_max t_audit t_val t_control delta skew retry batch_size packet_max mission_seed i8",
    "log_max i8",  # capacity of a log, bytes
    "plain u1",  # 1: without optimisations, as a reference for comparisons
)


class Fleet(NamedTuple):
    """State of N robots' c-nodes; all arrays but `settings`, `params` and the pools have one row per robot."""

    settings: Annotated[Any, Records(SETTINGS)]  # (1,)
    params: F64x1  # (P,), the controllers' parameters, the same for all: the mission
    robot: Annotated[Any, Records(ROBOT)]  # (N,)
    snode: U8x2  # (N, size), the s-nodes' memory
    anode: U8x2  # (N, size), the a-nodes' memory
    log: U8x2  # (N, front); begins at the start checkpoint (log.py)
    log_rest: U8x2  # (N, L - front or more), the rest of each log
    state: U8x2  # (N, C in whole cache lines), the controller's current state, in its encoded form
    checkpoint: U8x3  # (N, 2, C + 48): START, at which the log begins, and PENDING, which waits for tokens
    hckpt: U8x3  # (N, 2, 20): their hashes
    token: Annotated[Any, Records(TOKEN, 3)]  # (N, 2, K): the tokens that cover them
    peer: Annotated[Any, Records(PEER, 2)]  # (N, n_max): robots whose AUDIT packets or tokens were received
    peer_id: U16x2  # (N, n_max), their ids, in a separate array because most accesses only look up an id
    owed: Annotated[Any, Records(OWED, 2)]  # (N, n_max): answers and tokens for the same robots
    request: Pool  # rows of R bytes: requests that are being sent
    rx: Pool  # rows of R bytes: requests that are being received
    rx_info: Annotated[Any, Records(RX, 2)]  # (N, f_max + RX_SLOTS)
    memo: Memo  # cache of audits that passed
    taken: I64x2  # (N, audits_taken): when the last requests were accepted for audit


pack = bundled(Fleet)


def records(shape: int | tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return zeroed records whose fields are attributes, in compiled and in plain Python code."""
    made: NDArray[Any] = np.zeros(shape, dtype).view(np.recarray)
    return made


def _pages(size: int) -> int:
    return -(-size // PAGE_BYTES) * PAGE_BYTES


def make_fleet(
    n: int,
    config: BtiConfig,
    params: NDArray[np.float64],
    *,
    profile: int,
    controller: int,
    mission_seed: int,
    plain: bool = False,
    snode: NDArray[np.uint8],
    anode: NDArray[np.uint8],
) -> Fleet:
    """Return the state of `n` robots with ids 1..n, not powered up yet; `snode` and `anode` are as in `Nodes`.

    `controller` is the number of a bundled controller, or 0 for one in plain Python. `mission_seed` spreads the phases
    of the sensors. `plain` turns optimisations off, as a reference for comparisons; the bytes are the same.
    Source: docs/spec/rebound.md.
    """
    settings = records(1, SETTINGS)
    chosen = settings[0]
    chosen.profile, chosen.controller, chosen.mission_seed = profile, controller, mission_seed
    chosen.plain = plain
    chosen.f_max, chosen.t_audit, chosen.t_val = config.f_max, config.t_audit_ms, config.t_val_ms
    chosen.t_control, chosen.delta, chosen.skew = config.t_control_ms, config.delta_ms, config.skew_ms
    chosen.retry, chosen.batch_size, chosen.packet_max = config.retry_ms, config.batch_size, config.packet_max_bytes
    robot = records(n, ROBOT)
    robot["id"] = np.arange(1, n + 1)
    robot["request_row"] = NO_ROW
    state_bytes = config.checkpoint_capacity_bytes
    # In `paper` nothing limits what a compromised robot sends, and all its neighbours log it, so their logs are larger.
    room = PAPER_ROOM if profile == PAPER else 1
    log_bytes = room * config.log_capacity_bytes
    chosen.log_max = log_bytes
    is_whole = plain or n * log_bytes <= LARGE_LOGS_BYTES
    front = log_bytes if is_whole else min(log_bytes, LOG_FRONT_BYTES)
    places = config.f_max + RX_SLOTS
    requests = log_bytes + config.request_capacity_bytes - config.log_capacity_bytes
    fleet = Fleet(
        settings=settings,
        params=params,
        robot=robot,
        snode=snode,
        anode=anode,
        log=sparse(n, _pages(front)) if is_whole else np.zeros((n, lines(front)), np.uint8),
        log_rest=sparse(n, _pages(log_bytes - front)),
        state=np.zeros((n, lines(state_bytes)), np.uint8),
        checkpoint=np.zeros((n, 2, state_bytes + table.CHECKPOINT.size), np.uint8),
        hckpt=np.zeros((n, 2, HASH_BYTES), np.uint8),
        token=records((n, 2, config.tokens_kept), TOKEN),
        peer=records((n, config.n_max), PEER),
        peer_id=np.zeros((n, config.n_max), np.uint16),
        owed=records((n, config.n_max), OWED),
        request=make_pool(n, requests),
        rx=make_pool(n * places, requests),
        rx_info=records((n, places), RX),
        memo=make_memo(n, requests, state_bytes, 4 * (table.ENTRY_HEADER_BYTES + config.packet_max_bytes)),
        taken=np.full((n, config.audits_taken), LONG_AGO, np.int64),
    )
    return pack(fleet)


def held_tokens(fleet: Fleet, i: int, now_ms: int) -> list[tuple[int, float]]:
    """Return the auditors whose tokens robot i holds, each with the seconds its token is still valid.

    Source: RoboRebound §3.5.
    """
    robot, t_val = fleet.robot[i], int(fleet.settings[0].t_val)
    newest: dict[int, int] = {}
    for which, count in enumerate((robot.tokens_start, robot.tokens_pending)):
        for token in fleet.token[i, which, : int(count)]:
            newest[int(token.auditor)] = max(int(token.t), newest.get(int(token.auditor), 0))
    return [(auditor, (t + t_val - now_ms) / 1000) for auditor, t in newest.items() if t + t_val > now_ms]
