"""The attacks: the same robot, lying, in one class each."""

from .answers import Drain, StaleAnswers, WrongCheckpoint
from .attack import Attack, Plan
from .claims import Equivocate, FalseState, Masquerade, NotANumber
from .floods import CovertTalk, FrameFlood, GhostAuditors, Jam, LogFlood, LongFrames, RequestFlood, SlotSquat
from .forged_logs import (
    AlterEntries,
    DropEntries,
    ForgeCheckpoint,
    InsertEntries,
    ReorderEntries,
    StaleLog,
    SwapNodes,
    TruncateLog,
)
from .forged_tokens import Collude, ForgeTokens, ReplayTokens, SelfIssue, ShareTokens, ZeroKey
from .hijack import Dawdle, Flee, Hijack, Nondeterministic
from .options import check_options, idle_options
from .senses import Interleave, KeyOfTomorrow, SpoofGps, StarveSensors, StuckSensor
from .silence import Crash, OmitSends, RefuseAudit, RefuseToAudit
from .spoof import Spoof

ATTACKS: dict[str, type[Attack]] = {
    attack.name: attack
    for attack in (
        # What it says and does.
        Spoof, Masquerade, FalseState, Equivocate, NotANumber, OmitSends, Hijack, Flee,
        # What it shows to auditors.
        DropEntries, AlterEntries, ReorderEntries, InsertEntries, TruncateLog, ForgeCheckpoint, SwapNodes, StaleLog,
        Interleave, StarveSensors, KeyOfTomorrow, RefuseAudit, RefuseToAudit,
        # How it comes by tokens.
        ForgeTokens, ShareTokens, ReplayTokens, SelfIssue, Collude, ZeroKey,
        # What it does to the channel and to the audits of others.
        RequestFlood, FrameFlood, CovertTalk, GhostAuditors, LogFlood, LongFrames,
        SlotSquat, StaleAnswers, WrongCheckpoint, Drain,
        # Faults, and what no audit can see.
        Nondeterministic, Crash, StuckSensor, SpoofGps, Dawdle, Jam,
    )
}  # fmt: skip

__all__ = ["ATTACKS", "Attack", "Plan", "check_options", "idle_options"]
