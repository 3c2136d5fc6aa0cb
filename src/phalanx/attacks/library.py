"""The library of attacks, grouped by target: a table of `Attack` records."""

from __future__ import annotations

from functools import partial
from typing import Any

from phalanx.robot.adversary.attack import HOLE_OF_THE_PAPER, STOPPED, Attack, Option, by_defence
from phalanx.robot.adversary.harm import AIRTIME, ASTRAY, FALSE, FIX, STARVED, WRONG

HARMLESS = by_defence("harmless", "harmless", "harmless")
NOT_COVERED = by_defence("not covered", "not covered", "not covered")
BITES = by_defence("bites", "bites", "bites")
LIMITED = by_defence("bites", "bites", "limited")

CHECKED = {"unchecked": Option((0, 1))}


def flock(name: str, made_of: str, *rest: Any, **more: Any) -> Attack:
    """Return an attack on a flock; `made_of` names a module of this package and a class in it."""
    return Attack(name, f"{__package__}.{made_of}", *rest, **more)


errand = partial(flock, scene="errand", options={"at": Option(), **CHECKED})
team = partial(flock, scene="team", against="peers")
protocol = partial(flock, scene="protocol")  # harm: the score of its protocol

# fmt: off
LIBRARY: dict[str, tuple[Attack, ...]] = {
    "False packets and commands": (
        flock("spoof", "claims.Spoof", STOPPED, ASTRAY, 5,
               options={"strong": Option((0, 1), ("none",)), "every": Option(least=0.1)},
               does="claims in other robots' names that they are between a victim and the goal",
               stopped_by="replay sends no such state: auditors issue no tokens, and its old tokens expire"),
        flock("masquerade", "claims.Masquerade", STOPPED, ASTRAY, 1,
               does="impersonates one other robot, and claims that it is in the nearest robot's way",
               stopped_by="replay sends the robot's own state under its own id"),
        flock("false-state", "claims.FalseState", STOPPED, ASTRAY, 1,
               does="broadcasts a false position of its own, in the nearest robot's way",
               stopped_by="replay broadcasts what the s-node chained"),
        flock("equivocate", "claims.Equivocate", STOPPED, ASTRAY, 4,
               does="claims another position to each robot, always in that robot's way",
               stopped_by="replay sends one state; and with an a-node each packet is a broadcast, which all "
                          "receivers log"),
        flock("nan", "claims.NotANumber", by_defence("harmless", "stopped", "stopped"), ASTRAY, 0.5,
               does="broadcasts NaN, infinity and 10^30 as positions of all robots",
               stopped_by="controllers drop such numbers before use; and replay sends none"),
        # The same flock with other seeds: 0.2 to 0.3 m.
        flock("omit-sends", "hijack.OmitSends", STOPPED, ASTRAY, 0.4, on_wheels=True,
               does="stops broadcasting its state: others forget it and do not keep clear",
               stopped_by="replay sends states that the log lacks"),
        flock("hijack", "hijack.Hijack", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams the nearest robot instead of obeying its controller",
               stopped_by="the a-node has chained the commands, and replay computes different ones"),
        flock("flee", "hijack.Flee", STOPPED, ASTRAY, 0.5,
               does="drives away from the goal at full speed, out of range of all robots",
               stopped_by="its commands differ from replay; and out of range it gets no tokens"),
        flock("expel", "claims.Expel", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="claims that invented robots race outwards past the outermost ones, to lure these out of range",
               stopped_by="replay sends no such state; and in `hardened` the states of all neighbours together push "
                          "no harder than four of them can (phalanx docs adr/0026)"),
        flock("seize-orders", "claims.SeizeOrders", by_defence("harmless", "stopped", "stopped"), ASTRAY, 0.5,
               on_wheels=True,
               does="forges orders of the gateway: with the highest number, stops, and replayed ones",
               stopped_by="robots check an order's signature, number and age; and replay sends none"),
    ),
    "False claims in other protocols": (
        protocol("hog-cells", "claims.HogCells", against="warehouse",
                 does="claims the cells that the next two robots ask for",
                 stopped_by="replay claims the cells on the robot's own path"),
        protocol("claim-visits", "claims.ClaimVisits", against="patrol",
                 does="claims in each turn to have visited another place of the half that it never visits",
                 stopped_by="replay visits the places that the s-node chained"),
        protocol("claim-area", "claims.ClaimArea", against="exploration",
                 does="claims in each turn to have explored another place that no robot has visited",
                 stopped_by="replay visits the places that the s-node chained; and claims of a robot that falls silent "
                            "soon after are checked again"),
        protocol("open-breach", "claims.PointElsewhere", against="perimeter",
                 does="reports the last intruder beside the robot that is farthest from it",
                 stopped_by="replay reports the sightings that the s-node chained"),
        protocol("point-elsewhere", "claims.PointElsewhere", against="tracking",
                 does="reports the target beside the robot that is farthest from it",
                 stopped_by="replay reports the sightings that the s-node chained"),
        protocol("show-intruder", "logs.ShowThing", NOT_COVERED, against="perimeter",
                 does="shows its sensor, from outside, the intruder that was reported last",
                 stopped_by="nothing: the s-node chains the sensor's reading, and a robot that believes it is honest "
                            "(§2.2)"),
        protocol("show-target", "logs.ShowThing", NOT_COVERED, against="tracking",
                 does="shows its sensor, from outside, a target that is not there",
                 stopped_by="nothing, as with an intruder"),
    ),
    "False logs": (
        # The harm is small but no noise, as with `reorder-entries`: 3 m in 90 s (tests/attacks/test_small_harm.py).
        flock("drop-entries", "logs.DropEntries", STOPPED, ASTRAY, 0.1, on_wheels=True,
               does="leaves neighbours' messages out of its log, and drives as if alone",
               stopped_by="the a-node has chained each message: the shortened log does not hash to the chain's top"),
        flock("alter-entries", "logs.AlterEntries", STOPPED, ASTRAY, 0.5,
               does="logs a position 30 m aside, and drives and broadcasts accordingly",
               stopped_by="the s-node has chained the true reading"),
        flock("reorder-entries", "logs.ReorderEntries", STOPPED, ASTRAY, 0.05,
               does="logs messages 3 s after they came, behind the outputs that they should have changed",
               stopped_by="the a-node's chain has another order"),
        flock("insert-entries", "logs.InsertEntries", STOPPED, ASTRAY, 0.4,
               does="logs messages of an invented robot, and makes way for it",
               stopped_by="the a-node has chained no such message"),
        flock("truncate-log", "logs.TruncateLog", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and cuts its log off: each log begins at an invented boot",
               stopped_by="a log from boot must begin with empty chains, and the chains are long"),
        flock("forge-checkpoint", "logs.ForgeCheckpoint", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and begins its log at a checkpoint taken afterwards, with the tokens of "
                    "an older one",
               stopped_by="tokens cover the hash of the checkpoint that was audited"),
        flock("swap-nodes", "logs.SwapNodes", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and presents the a-node's chain and authenticator as the s-node's",
               stopped_by="authenticators cover the kind of their chain (`paper`), or a-nodes make none "
                          "(`hardened`)"),
        flock("stale-log", "logs.StaleLog", HOLE_OF_THE_PAPER, ASTRAY, 1.5, on_wheels=True,
               does="rams, and presents its last honest log and its authenticators with each new token request",
               stopped_by="in `hardened` the token request covers the chain's top, and the authenticators cover "
                          "the request"),
        flock("interleave", "logs.Interleave", HOLE_OF_THE_PAPER, ASTRAY, 0.2,
               does="polls its sensors twelve times at once, and acts on these readings for 3 s",
               stopped_by="in `hardened`, entries carry the trusted nodes' time: readings are on a time grid, and "
                          "outputs follow within δ"),
        flock("starve-sensors", "logs.StarveSensors", HOLE_OF_THE_PAPER, ASTRAY, 0.4,
               does="stops polling its sensors, so that no output is due, and keeps its last command; passes audits",
               stopped_by="in `hardened`, readings are on a time grid without gaps up to the token request"),
        flock("t-key", "logs.KeyOfTomorrow", STOPPED, ASTRAY, 0.4,
               does="stops polling its sensors, and claims that the mission key comes in 49 days: no reading is due "
                    "until then",
               stopped_by="a log from boot must begin before its own token request"),
        flock("refuse-audit", "hijack.RefuseAudit", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and shows no log",
               stopped_by="tokens expire: a robot that is not audited is stopped"),
        flock("refuse-to-audit", "hijack.RefuseToAudit", HARMLESS, STARVED, 1, crowd=True,
               does="accepts audit requests, and answers none",
               stopped_by="no defence is needed: robots ask other auditors, and P2 requires f_max + 2 correct robots "
                          "in range"),
    ),
    "False tokens": (
        flock("forge-tokens", "tokens.ForgeTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and offers its a-node a hundred tokens with guessed MACs a second",
               stopped_by="MACs have 64 bits, and no c-node knows their key"),
        flock("share-tokens", "tokens.ShareTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and offers tokens that it issued to others as its own",
               stopped_by="the MAC covers the auditee's id"),
        flock("replay-tokens", "tokens.ReplayTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and installs its expired tokens again and again",
               stopped_by="a token's age counts from its request, however late it is installed"),
        flock("self-issue", "tokens.SelfIssue", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="rams, and has its own a-node issue tokens to itself",
               stopped_by="IssueToken refuses its own id; and each auditor counts once"),
        flock("collude", "tokens.Collude", STOPPED, ASTRAY, 4, crowd=True,
               does="rams; compromised robots issue tokens to each other without an audit",
               stopped_by="each gets f_max - 1 tokens from the others and needs f_max + 1"),
        flock("zero-key", "tokens.ZeroKey", HOLE_OF_THE_PAPER, ASTRAY, 1.5,
               does="forges tokens before the mission key is loaded, under a zero key and 49 days ahead; then rams",
               stopped_by="in `hardened` a node without a key computes no MAC, and loading a key clears the tokens"),
    ),
    "Attacks on the channel and on others' audits": (
        flock("request-flood", "channel.RequestFlood", by_defence("harmless", "bites", "limited"), STARVED, 1,
               does="sends auditors empty audit requests in all robots' names, so that valid ones are rejected",
               stopped_by="nothing ends it; in `hardened` the a-node writes the source, and auditors accept one "
                          "request of a robot per T_audit / 2"),
        flock("frame-flood", "channel.FrameFlood", LIMITED, AIRTIME, 40,
               does="fills the channel with long AUDIT packets, which are not logged",
               stopped_by="nothing ends it; in `hardened` a leaky bucket in the a-node limits the airtime of AUDIT "
                          "packets"),
        flock("talk-over", "channel.TalkOver", HARMLESS, STARVED, 1, crowd=True,
               does="jams, with short AUDIT packets, robots out of its range while they request audits",
               stopped_by="lost fragments are repeated at unpredictable times; in `hardened` the a-node's bucket "
                          "limits the jamming time"),
        flock("mask", "channel.Mask", HARMLESS, STARVED, 1, crowd=True,
               does="jams every HELLO and audits nobody, so that robots learn of no auditors",
               stopped_by="a robot that lacks tokens sends SEEK at an unpredictable time, and each robot that hears it "
                          "answers by unicast until the answer has arrived"),
        flock("talk-over-replies", "replies.TalkOverReplies", HARMLESS, STARVED, 1, crowd=True,
               does="jams a victim after its requests, so that tokens of auditors out of the attackers' range are lost",
               stopped_by="a robot that lacks tokens sends SEEK at a random time, and each auditor repeats its token "
                          "at another one"),
        flock("relay-hello", "replies.RelayHello", HARMLESS, STARVED, 1, crowd=True,
               options={"both": Option((0, 1))},
               does="relays HELLOs of distant robots to a victim, so that it requests audits from them in vain",
               stopped_by="after an unanswered request a robot asks only auditors that answer the nonce of its SEEK"),
        flock("covert-talk", "channel.CovertTalk", LIMITED, AIRTIME, 4,
               does="sends data to another compromised robot or to the nearest receiver in AUDIT packets, which no log "
                    "contains",
               stopped_by="nothing ends it; in `hardened` the a-node's bucket limits how much"),
        flock("ghost-auditors", "channel.GhostAuditors", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="broadcasts states of 400 invented robots, from which others then request audits in vain",
               stopped_by="in `hardened` robots choose auditors among the senders of tokens and AUDIT packets, never "
                          "among claimed ones"),
        flock("log-flood", "channel.LogFlood", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="broadcasts long meaningless packets, which all receivers must log, until their logs are full",
               stopped_by="replay sends no such packet; and in `hardened` the a-node's bucket limits the bytes of "
                          "broadcasts"),
        flock("long-frames", "channel.LongFrames", by_defence("harmless", "bites", "stopped"), STARVED, 1, crowd=True,
               does="audits nobody, and fills receivers' logs with packets of the airtime of four states",
               stopped_by="replay sends no such packet; and in `hardened` logs have room for f_max such robots until "
                          "they are stopped"),
        flock("slot-squat", "channel.SlotSquat", HARMLESS, STARVED, 1, crowd=True,
               does="begins audit requests to all robots and completes none, so that auditors have no room for others",
               stopped_by="an auditor drops a request that is incomplete for too long, and accepts no other from its "
                          "sender before T_audit / 2"),
        flock("push-out", "channel.PushOut", HARMLESS, STARVED, 1, crowd=True,
               does="audits nobody, and begins a request to the victim's auditor between the victim's fragments",
               stopped_by="an auditor has room for requests of f_max + 3 robots, one for each"),
        flock("stale-answers", "tokens.StaleAnswers", HARMLESS, STARVED, 1, crowd=True,
               does="answers every other audit request with the last valid token that it issued to that robot",
               stopped_by="no defence is needed: only a token that is not older than the request counts as an answer"),
        flock("wrong-checkpoint", "tokens.WrongCheckpoint", HARMLESS, STARVED, 1, crowd=True,
               does="answers audit requests with fresh tokens for the checkpoint at the beginning of the log",
               stopped_by="no defence is needed: only a token for the checkpoint that the request claims counts as an "
                          "answer"),
        flock("drain", "tokens.Drain", HARMLESS, STARVED, 1, crowd=True,
               does="sends each auditor a valid token request again and again, to use up its audits",
               stopped_by="no defence is needed: a token request counts once, and a-nodes make few"),
    ),
    "Faults, and attacks that no audit can detect": (
        flock("nondeterministic", "hijack.Nondeterministic", by_defence("harmless", "stopped", "stopped"), ASTRAY, 1,
               does="a fault, no attack: the last bit of each command is random",
               stopped_by="replay computes other bytes: audits cannot tell it from an attack (phalanx docs adr/0012)"),
        flock("crash", "hijack.Crash", STOPPED, ASTRAY, 0.4, on_wheels=True,
               does="a fault: its c-node stops, and the actuators continue with the last command",
               stopped_by="replay has commands and messages that the log lacks; and it requests no audits"),
        flock("stuck-sensor", "logs.StuckSensor", NOT_COVERED, ASTRAY, 0.4,
               does="a fault, no attack: its position sensor repeats its last reading",
               stopped_by="nothing: the log shows a robot that stands still, as an honest one would with these "
                          "readings"),
        flock("gps-spoof", "logs.SpoofGps", NOT_COVERED, ASTRAY, 0.4,
               does="makes its position sensor drift, from outside",
               stopped_by="nothing: the s-node chains the sensor's reading, and a robot that believes it behaves "
                          "correctly (§2.2)"),
        # The harm is small but no noise: the undelayed run is identical to the bit until the first delay, and a robot
        # that delays by the period alone stays within a millimetre of it (tests/attacks/test_small_harm.py).
        flock("in-protocol", "hijack.Dawdle", NOT_COVERED, ASTRAY, 0.02,
               does="delays each reading by almost δ and each output by almost δ, as late as the protocol allows",
               stopped_by="nothing: a robot that follows the protocol is correct by definition (§3.9)"),
        flock("jam", "channel.Jam", NOT_COVERED, AIRTIME, 40,
               does="fills the channel with a transmitter that bypasses the a-node",
               stopped_by="no software can; robots that get no tokens stop, which is safe"),
    ),
    "Attacks on the delivery": (
        errand("flip-bit", "missions.files.FlipBit", STOPPED, WRONG, 1,
               against="file", options={"bit": Option(), **CHECKED},
               does="changes one bit of the mission on its way to the robot",
               stopped_by="the signature does not verify; and each record is bound to the experience and the header "
                          "(`paper`; phalanx docs adr/0017) or authenticated under keys from them (`hardened`), so "
                          "that it does not decode"),
        errand("forge-graph", "missions.files.ForgeGraph", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="replaces the operator's mission and start key by its own",
               stopped_by="in `hardened` the robot does not trust the signer; `paper` has no signatures"),
        errand("replay-day", "missions.files.ReplayDay", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="replays yesterday's mission, start key and messages",
               stopped_by="in `hardened` the mission's time window is signed, and over"),
        errand("replay-robot", "missions.files.ReplayRobot", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="sends the robot another robot's mission, start key and messages",
               stopped_by="in `hardened` the mission's robots are signed, and this one is not among them"),
        errand("replay-again", "missions.files.ReplayAgain", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="replays today's mission after it was completed",
               stopped_by="in `hardened` a robot remembers which missions it has started, and starts each once"),
        errand("set-clock", "missions.files.SetClock", by_defence("bites", "bites", "not covered"), WRONG, 1,
               against="clock",
               does="holds back a mission for a day, and sets the robot's clock back by that day when it delivers it",
               stopped_by="nothing, if the robot has never started it: time windows rely on the robot's clock, "
                          "which is trusted"),
        errand("swap-key", "missions.files.SwapKey", by_defence("harmless", "harmless", "stopped"), WRONG, 1,
               against="start key",
               does="sends yesterday's start key with today's mission",
               stopped_by="a start key names its mission, and opens no other; missions in `none` and `paper` "
                          "have no start key"),
    ),
    "Attacks on sensors and messages": (
        errand("spoof-scan", "missions.between.SpoofScan", STOPPED, FALSE, 1, against="sensors",
               does="shows the lidar another room, in which a door stands elsewhere",
               stopped_by="a landmark at another place does not decode; without a match the robot gets no position "
                          "fix and no next node"),
        errand("drag-scan", "missions.between.DragScan", by_defence("harmless", "not covered", "not covered"), FIX, 0.5,
               against="sensors",
               does="shows the lidar the true building, shifted aside by 5 cm a second",
               stopped_by="nothing: an attacker who can show the lidar a whole building is believed; between two nodes "
                          "all fixes together may move the robot by no more than it can have drifted, but from each "
                          "node on they may again; in `none` no landmark misleads or corrects the robot"),
        # Its limit is what can have drifted: 0.25 m, and a tenth of the 7 m that it can drive until the time-out.
        errand("freeze-scan", "missions.between.FreezeScan", by_defence("harmless", "limited", "limited"), FIX, 0.3,
               against="sensors", limit=1.0,
               does="a fault, no attack: the lidar repeats its last scan",
               stopped_by="the frozen landmark tells the robot at each step that it has not moved; the robot believes "
                          "that until the fixes add up to more than it can have drifted; then no node decodes, and "
                          "the time-out stops it; in `none` no landmark misleads or corrects the robot"),
        errand("move-code", "missions.between.MoveCode", STOPPED, WRONG, 1, against="walls",
               does="hangs the code of the shelf 5 m before it",
               stopped_by="the text is public, but hashed together with its position: elsewhere it does not decode"),
        errand("clone-code", "missions.between.CloneCode", by_defence("bites", "harmless", "harmless"), WRONG, 1,
               against="walls",
               does="hangs a copy of the code of the shelf 5 m before it",
               stopped_by="the copy does not decode at its position; the robot continues to the code itself"),
        errand("nudge-code", "missions.between.NudgeCode", HARMLESS, FIX, 0.3,
               against="walls",
               does="hangs the code of the shelf 0.4 m aside",
               stopped_by="the robot knows the uncertainty of its pose; a code moved farther does not decode"),
        errand("stale-message", "missions.between.StaleMessage", STOPPED, WRONG, 1, against="messages",
               does="replays yesterday's release, which the robot waits for and which nobody gave today",
               stopped_by="a controller's message is random and made anew for each mission: yesterday's opens "
                          "nothing today"),
        errand("drown-message", "missions.between.DrownMessage", by_defence("harmless", "stopped", "stopped"), WRONG,
               against="messages",
               does="sends the robot random messages until it drops the valid one",
               stopped_by="the robot does nothing wrong; it waits until the valid message is sent again"),
    ),
    "Faults of the body": (
        errand("dead-wheel", "missions.between.DeadWheel", STOPPED, FALSE, 1, against="body",
               does="a fault: one wheel spins without moving the robot, which odometry cannot detect",
               stopped_by="landmarks are not where odometry expects them: no node decodes"),
        errand("slip", "missions.between.Slip", STOPPED, FALSE, 1, against="body",
               does="lets both wheels slip: each moves the robot half as far as it turns",
               stopped_by="as for `dead-wheel`; slip of less than a tenth is drift, and is corrected"),
    ),
    "Attacks by a robot on an audited mission": (
        team("skip-node", "missions.cheat.SkipNode", STOPPED, WRONG, 1,
               does="continues as if it had decoded a node that it never saw",
               stopped_by="replay has not decoded the node: it drives elsewhere, and the next claimed node is not "
                          "reachable"),
        team("drive-dark", "missions.cheat.DriveDark", STOPPED, WRONG, 1,
               does="drives to a place that no decoded node leads to",
               stopped_by="the a-node has chained the commands, and replay computes different ones"),
        team("show-unsensed", "missions.cheat.ShowUnsensed", STOPPED, WRONG, 1,
               does="decodes a node from an invented scan, and presents that scan",
               stopped_by="its s-node has chained the hash of another scan"),
        team("forge-claim", "missions.cheat.ForgeClaim", STOPPED, WRONG, 1,
               does="claims a node, with the correct bytes, on a scan that does not show it",
               stopped_by="auditors extract the landmarks from the scan themselves"),
    ),
}
# fmt: on

ATTACKS: dict[str, Attack] = {attack.name: attack for group in LIBRARY.values() for attack in group}
IN_FLOCKS = {name: attack for name, attack in ATTACKS.items() if attack.scene == "flock"}
IN_PROTOCOLS = {name: attack for name, attack in ATTACKS.items() if attack.scene == "protocol"}
IN_SWARMS = IN_FLOCKS | IN_PROTOCOLS
ON_MISSIONS = {name: attack for name, attack in ATTACKS.items() if name not in IN_SWARMS}
