"""Reasons why an auditor issues no token. They are stored for the operator and never sent."""

from __future__ import annotations

from enum import IntEnum


class Refusal(IntEnum):
    """Reason for a failed audit: the first check that failed. The numbers are not in the order of the checks.

    Source: RoboRebound §3.7; docs/spec/rebound.md.
    """

    NONE = 0
    MALFORMED = 1  # not a request, or its length differs from the sum of its parts
    NOT_THE_SENDER = 2  # the named auditee is not the packet's source
    TOO_FEW_TOKENS = 3  # for the start checkpoint
    TOKEN_TWICE = 4  # two tokens for the start checkpoint are from the same auditor
    TOKEN_INVALID = 5  # a token does not cover the start checkpoint
    AUTHENTICATOR_INVALID = 6  # of the s- or a-node, or not bound to this token request
    ENTRY_MALFORMED = 7
    AUDIT_FRAME_LOGGED = 8  # an AUDIT packet, which a-nodes do not chain
    OUT_OF_ORDER = 9  # an entry is older than a previous one by more than the skew, or later than the request
    INPUT_OFF_GRID = 10
    INPUT_MISSING = 11
    CHECKPOINT_MISSING = 12  # none in the segment, or two
    CHECKPOINT_NOT_FLUSHED = 13  # taken with entries waiting in a batch
    S_CHAIN = 14  # the readings shown are not those that the s-node chained
    A_CHAIN = 15  # the messages and commands shown are not those that the a-node chained
    STATE_MALFORMED = 16  # the start checkpoint has no valid controller's state
    OUTPUT_WRONG = 17  # the replay sends or commands something else
    OUTPUT_UNCALLED = 18  # the replay sends or commands nothing here
    OUTPUT_LATE = 19
    OUTPUT_MISSING = 20
    OUTPUT_PENDING = 21  # a checkpoint comes before an output that the replay has produced
    CHECKPOINT_WRONG = 22  # the replay ends in another state
    REQUEST_INVALID = 23  # the auditor's own a-node issues no token for it
    CONTROLLER_FAILED = 24  # a plain-Python controller raised an exception during replay
    EVIDENCE_WRONG = 25  # the evidence does not show what is claimed, or not what the s-node chained
    DEFECT = 26  # an assertion in the auditor's own code failed: a bug in phalanx, which is logged
