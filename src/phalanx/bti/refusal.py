"""Why an auditor gives no token: kept for the operator, sent to nobody."""

from __future__ import annotations

from enum import IntEnum


class Refusal(IntEnum):
    """The first of the auditor's checks that failed; the numbers are for logs, and not their order.

    Source: RoboRebound §3.7; docs/spec/rebound.md.
    """

    NONE = 0
    MALFORMED = 1  # not a request, or longer or shorter than it says
    NOT_THE_SENDER = 2  # the auditee named is not the packet's source
    TOO_FEW_TOKENS = 3  # for the start checkpoint
    TOKEN_TWICE = 4  # two of the start's tokens are of one auditor
    TOKEN_INVALID = 5  # one does not cover the start checkpoint
    AUTHENTICATOR_INVALID = 6  # of the s- or a-node, or not bound to this token request
    ENTRY_MALFORMED = 7
    AUDIT_FRAME_LOGGED = 8  # no a-node chains one
    OUT_OF_ORDER = 9  # entries further from the order of time than the skew, or later than the request
    INPUT_OFF_GRID = 10
    INPUT_MISSING = 11
    CHECKPOINT_MISSING = 12  # none in the segment, or two
    CHECKPOINT_NOT_FLUSHED = 13  # taken with entries waiting in a batch
    S_CHAIN = 14  # the readings shown are not those that the s-node chained
    A_CHAIN = 15  # the messages and commands shown are not those that the a-node chained
    STATE_MALFORMED = 16  # the start checkpoint is not a controller's state
    OUTPUT_WRONG = 17  # replay sends or commands something else
    OUTPUT_UNCALLED = 18  # replay sends or commands nothing here
    OUTPUT_LATE = 19
    OUTPUT_MISSING = 20
    OUTPUT_PENDING = 21  # a checkpoint while replay still owes an output
    CHECKPOINT_WRONG = 22  # replay arrives at another state
    REQUEST_INVALID = 23  # the auditor's own a-node issues no token for it
    CONTROLLER_FAILED = 24  # replay of a plain-Python controller raised
    EVIDENCE_WRONG = 25  # it does not show what is claimed, or not what the s-node chained
    DEFECT = 26  # a check in the auditor's own code failed: a defect of ours, which is logged
