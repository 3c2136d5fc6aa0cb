"""State of N c-nodes as arrays with one row per robot: kernels take them and a robot's index.

Nothing here is trusted: the trusted nodes' own memory lies in `snode` and `anode`; only the C in firmware/ reads it.
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

# The firmware's profiles, and none: a robot without trusted nodes, whose entries nobody chains or logs.
HARDENED, PAPER, PLAIN = 0, 1, 2
# Requests that are put together from fragments at the same time, beside one of each of f_max compromised robots: these
# push nobody out (docs/adr/0014).
RX_SLOTS = 3
PAPER_ROOM = 6
START, PENDING = 0, 1
LONG_AGO = -(1 << 40)
# Where all logs would be larger than the first, so much of each lies close to others': with ten neighbours few logs are
# longer, with 24 most.
LARGE_LOGS_BYTES, LOG_FRONT_BYTES = 8 << 20, 2688

ROBOT = layout(
    "id u2",
    "alive u1",  # powered and keyed
    "log_full u1",
    # What each event needs lies together: of large swarms it is not near, and each line of it is waited for.
    "booted u1",  # the log begins at boot, not at a checkpoint
    "seeks u1",  # 0; in a round in which it asks only robots that have answered its SEEK: 1, and 1 for each SEEK so far
    "log_len i8",
    "log_max i8",  # longest log so far
    "state_len i8",
    "step i8",  # INPUTs so far
    "peers i8",
    "t_key i8",  # ms of the robot's own clock, at which its mission key was loaded
    "phase i8",  # ms; its sensors' grid is t_key + phase + k * t_control
    "checkpoint_no i8",  # of the checkpoint that was taken last
    "start_no i8",  # of the one at which the log begins
    "checkpoint_at i8",  # where in the log the pending checkpoint's mark stands, -1 if there is none
    "start_len i8",  # of what the log begins with: a checkpoint, or `booted`
    "pending_len i8",
    "round_no i8",  # not `round`: uncompiled, that is a method of any record
    "quota i8",  # requests that may still go out before the next retry
    "got i8",  # tokens in this round
    "asked_at i8",
    "request_no request_to u2",
    "request_len i8",  # of the request under way, 0 if none
    "request_row i4",  # where it is, NO_ROW if nowhere
    "nonce u4",  # of this round's SEEK; drawn from the secret
    f"secret {MAC_BYTES}u1",  # the MAC of an authenticator that is shown to nobody: of it all random times are drawn
    "round_at i8",  # when this round began
    "drawn_in i8",  # one more than the round for which they were drawn
    "seek_at i8",  # when it sends the next SEEK, ms of the robot's clock
    "retry_at i8",  # when further robots may be asked
    "answer_at i8",  # when it answers the next SEEK; 0: none is left
    "request_next i8",  # its next fragment
    "repeats i8",  # how often fragments of it were said again
    "repeat_at i8",  # when the next fragment may be said, ms of the robot's clock
    "tokens_start tokens_pending i8",
    "accepted i8",  # requests taken for audit, ever
    "requests_sent tokens_got audits_passed audits_refused i8",
)
TOKEN = layout("auditor t i8", f"mac {MAC_BYTES}u1")
PEER = layout(
    "heard i8",  # ms of our clock, of the newest AUDIT packet from it
    "token i8",  # t of its newest token
    "asked_ms i8",  # when we last asked it
    "took i8",  # ms at which we last took a request of its
    "took_t i8",  # and that request's own time
    "here i8",  # ms at which it last answered a SEEK of ours
    "asked i4",  # round in which we last asked it
    "claimed i4",  # the checkpoint that was about, by its number
    "answered i4",  # round in which it last gave us a token
    "misses i4",  # rounds in a row in which we asked it for nothing
)
# What a robot owes each of its peers.
OWED = layout(
    "sought i8",  # ms of our clock, of the last SEEK from it that we took
    "answer_at i8",  # when to answer it; 0: it is answered
    "nonce since i8",  # out of that SEEK
    "t i8",  # of the last request of its that passed; the token's MAC, and the request's number
    f"mac {MAC_BYTES}u1",
    "no i8",
)
RX = layout(
    "src i8",  # who sends it, 0: nobody, and the row is not the place's any more
    "no count have len at i8",
    "row i8",  # where it is, or was last
)
SETTINGS = layout(
    "profile controller f_max t_audit t_val t_control delta skew retry batch_size packet_max mission_seed i8",
    "log_max i8",  # bytes that a log has room for
    "plain u1",  # nothing is computed in a clever way: a run to compare with
)


class Fleet(NamedTuple):
    """N robots' c-nodes; every array but `settings`, `params` and what is lent has one row a robot."""

    settings: Annotated[Any, Records(SETTINGS)]  # (1,)
    params: F64x1  # (P,), the controllers' parameters, the same for all: the mission
    robot: Annotated[Any, Records(ROBOT)]  # (N,)
    snode: U8x2  # (N, size), the trusted nodes' memory
    anode: U8x2  # the same
    log: U8x2  # (N, front); begins at the start checkpoint (log.py)
    log_rest: U8x2  # (N, L - front or more), what of a log does not fit there
    state: U8x2  # (N, C in whole lines), the controller's live state, which is its own encoding
    checkpoint: U8x3  # (N, 2, C + 48): the one at which the log begins, and the one that waits for tokens
    hckpt: U8x3  # (N, 2, 20): their hashes
    token: Annotated[Any, Records(TOKEN, 3)]  # (N, 2, K): the tokens that cover them
    peer: Annotated[Any, Records(PEER, 2)]  # (N, n_max): robots whose AUDIT packets or tokens were heard
    peer_id: U16x2  # (N, n_max), who they are: beside the rest, as most of what is asked is who is known
    owed: Annotated[Any, Records(OWED, 2)]  # (N, n_max): answers and tokens for the same robots
    request: Pool  # of R bytes: requests under way
    rx: Pool  # of R bytes: requests that arrive in fragments
    rx_info: Annotated[Any, Records(RX, 2)]  # (N, f_max + RX_SLOTS)
    memo: Memo  # audits that passed
    taken: I64x2  # (N, audits_taken): when the last requests were taken for audit


pack = bundled(Fleet)


def records(shape: int | tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Zeroed records whose fields are attributes, compiled and not."""
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
    """A fleet of `n` robots that are not powered up yet, with ids 1..n, of manufactured nodes, (n, size).

    `controller` is a bundled one's number, 0 for one in plain Python; `mission_seed` spreads the sensors' phases;
    `plain` is for a run that others are compared with, whose bytes are the same.
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
    # As printed nothing limits what a compromised robot sends, and all who hear it log it: room for that is the
    # robots' own affair.
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


def vouchers(fleet: Fleet, i: int, now_ms: int) -> list[tuple[int, float]]:
    """Return the auditors whose tokens robot i holds, each with the seconds its token is still valid.

    Source: RoboRebound §3.5.
    """
    robot, t_val = fleet.robot[i], int(fleet.settings[0].t_val)
    newest: dict[int, int] = {}
    for which, count in enumerate((robot.tokens_start, robot.tokens_pending)):
        for token in fleet.token[i, which, : int(count)]:
            newest[int(token.auditor)] = max(int(token.t), newest.get(int(token.auditor), 0))
    return [(auditor, (t + t_val - now_ms) / 1000) for auditor, t in newest.items() if t + t_val > now_ms]
