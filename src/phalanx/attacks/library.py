"""All attacks there are, by what they are about: a table of records (attack.py)."""

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
    """Return an attack whose class `made_of` is a module of this package and a name."""
    return Attack(name, f"{__package__}.{made_of}", *rest, **more)


errand = partial(flock, scene="errand", options={"at": Option(), **CHECKED})
team = partial(flock, scene="team", against="peers")
protocol = partial(flock, scene="protocol")  # its harm is what its protocol counts

# fmt: off
LIBRARY: dict[str, tuple[Attack, ...]] = {
    "What it says and does": (
        flock("spoof", "claims.Spoof", STOPPED, ASTRAY, 5,
               options={"strong": Option((0, 1), ("none",)), "every": Option(least=0.1)},
               does="claims on behalf of other robots that they stand between a victim and the goal",
               stopped_by="replay never sends such a state: no auditor issues a token, and the tokens it has run out"),
        flock("masquerade", "claims.Masquerade", STOPPED, ASTRAY, 1,
               does="speaks in one other robot's name only, which it has stand in the nearest robot's way",
               stopped_by="replay sends its own state under its own id"),
        flock("false-state", "claims.FalseState", STOPPED, ASTRAY, 1,
               does="broadcasts in its own name a place before the nearest robot, where it is not",
               stopped_by="replay broadcasts what the s-node chained"),
        flock("equivocate", "claims.Equivocate", STOPPED, ASTRAY, 4,
               does="tells each robot another place where it is, always in that robot's way",
               stopped_by="replay sends one state; and with an a-node each packet is a broadcast, which all hear "
                          "and log"),
        flock("nan", "claims.NotANumber", by_defence("harmless", "stopped", "stopped"), ASTRAY, 0.5,
               does="broadcasts NaN, infinity and 10^30 as everybody's place",
               stopped_by="controllers drop such numbers before they compute; and replay sends none"),
        # The same flock with other dice: 0.2 to 0.3 m.
        flock("omit-sends", "hijack.OmitSends", STOPPED, ASTRAY, 0.4, on_wheels=True,
               does="stops broadcasting where it is: others forget it, and do not keep clear",
               stopped_by="replay sends states that the log lacks"),
        flock("hijack", "hijack.Hijack", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives into the way of others, whatever its controller says",
               stopped_by="the a-node has chained the commands, and replay gives others"),
        flock("flee", "hijack.Flee", STOPPED, ASTRAY, 0.5,
               does="drives away from the goal as fast as it can, out of everybody's range",
               stopped_by="its commands differ from replay; and out of range it gets no tokens at all"),
        flock("expel", "claims.Expel", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="says that invented robots race outwards past those farthest out: who keeps pace is out of range",
               stopped_by="replay sends no such state; and in `hardened` all that neighbours say pushes no harder than "
                          "four of them can (phalanx docs adr/0026)"),
        flock("seize-orders", "claims.SeizeOrders", by_defence("harmless", "stopped", "stopped"), ASTRAY, 0.5,
               on_wheels=True,
               does="gives orders to all in the gateway's name, with the highest number, stops, and old ones again",
               stopped_by="robots check who signed an order, its number and its age; and replay sends none"),
    ),
    "What it claims to do, in other protocols": (
        protocol("hog-cells", "claims.HogCells", against="warehouse",
                 does="claims, of the cells that others ask for, those of the two that are about to drive",
                 stopped_by="replay claims the cells that lie on its way"),
        protocol("claim-visits", "claims.ClaimVisits", against="patrol",
                 does="says in each turn that it has just been at another place of the half that it never visits",
                 stopped_by="replay has been where its sensor says"),
        protocol("claim-area", "claims.ClaimArea", against="exploration",
                 does="says in each turn of another place where nobody was that it has seen it",
                 stopped_by="replay has been where its sensor says; and what a robot said that fell silent soon after "
                            "is seen again"),
        protocol("open-breach", "claims.PointElsewhere", against="perimeter",
                 does="says of the intruder that was seen last that it comes where the robot farthest from it is",
                 stopped_by="replay says what the s-node chained that it sees, and where"),
        protocol("point-elsewhere", "claims.PointElsewhere", against="tracking",
                 does="says that the target is where the robot farthest from it is",
                 stopped_by="replay says what the s-node chained that it sees, and where"),
        protocol("show-intruder", "logs.ShowThing", NOT_COVERED, against="perimeter",
                 does="somebody outside shows its sensor, close by, the intruder that was spoken of last",
                 stopped_by="nothing: the s-node chains what the sensor says, and a robot that believes it is honest "
                            "(§2.2)"),
        protocol("show-target", "logs.ShowThing", NOT_COVERED, against="tracking",
                 does="somebody outside shows its sensor, close by, a target that is not there",
                 stopped_by="nothing, as with an intruder"),
    ),
    "What it shows to auditors": (
        # Little, and no noise, as with `reorder-entries`: three metres in 90 s (tests/attacks/test_small_harm.py).
        flock("drop-entries", "logs.DropEntries", STOPPED, ASTRAY, 0.1, on_wheels=True,
               does="leaves out of its log what its neighbours say, and drives as if it were alone",
               stopped_by="the a-node has chained each message: without them its chain does not re-hash to the top"),
        flock("alter-entries", "logs.AlterEntries", STOPPED, ASTRAY, 0.5,
               does="writes into its log that it is 30 m from where it is, and drives and speaks accordingly",
               stopped_by="the s-node has chained the true reading"),
        flock("reorder-entries", "logs.ReorderEntries", STOPPED, ASTRAY, 0.05,
               does="moves what it hears 3 s down in its log, behind what it should have told it",
               stopped_by="the order in the a-node's chain is another one"),
        flock("insert-entries", "logs.InsertEntries", STOPPED, ASTRAY, 0.4,
               does="writes into its log that an invented robot crowds it, and makes way for that",
               stopped_by="the a-node has chained no such message"),
        flock("truncate-log", "logs.TruncateLog", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and cuts its log off behind it: each log begins at a boot that never was",
               stopped_by="a log that begins at boot begins with empty chains, and these are long"),
        flock("forge-checkpoint", "logs.ForgeCheckpoint", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and begins its log at a checkpoint taken after that, with the tokens of "
                    "an older one",
               stopped_by="tokens cover the hash of the checkpoint that was audited"),
        flock("swap-nodes", "logs.SwapNodes", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and shows the a-node's chain and authenticator as the s-node's",
               stopped_by="authenticators are made over the kind of their chain (`paper`) or not made by a-nodes "
                          "at all (`hardened`)"),
        flock("stale-log", "logs.StaleLog", HOLE_OF_THE_PAPER, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and shows its last honest log, authenticators and all, with each new "
                    "token request",
               stopped_by="in `hardened` the token request is made over the chain's top, and the authenticators over "
                          "the request"),
        flock("interleave", "logs.Interleave", HOLE_OF_THE_PAPER, ASTRAY, 0.2,
               does="polls its sensors twelve times at once, and for 3 s acts on and broadcasts where it was then",
               stopped_by="in `hardened`, entries carry the trusted nodes' time: readings lie on a grid, outputs "
                          "follow within δ"),
        flock("starve-sensors", "logs.StarveSensors", HOLE_OF_THE_PAPER, ASTRAY, 0.4,
               does="does not poll its sensors, so that nothing is due, and goes on as last commanded; is audited "
                    "as ever",
               stopped_by="in `hardened`, readings lie on a grid and none may be missing up to the token request"),
        flock("t-key", "logs.KeyOfTomorrow", STOPPED, ASTRAY, 0.4,
               does="polls no sensors, and says that the mission key comes in 49 days, so that no reading is due "
                    "until then",
               stopped_by="a log that begins at boot begins before its own token request"),
        flock("refuse-audit", "hijack.RefuseAudit", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and shows its log to nobody",
               stopped_by="tokens run out by themselves: not to be audited is to be stopped"),
        flock("refuse-to-audit", "hijack.RefuseToAudit", HARMLESS, STARVED, 1, crowd=True,
               does="takes requests for audits, and answers none",
               stopped_by="nothing has to: others are asked instead, of which P2 wants f_max + 2 correct ones in "
                          "range"),
    ),
    "How it comes by tokens": (
        flock("forge-tokens", "tokens.ForgeTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and offers its a-node a hundred tokens with guessed MACs each second",
               stopped_by="a MAC of 64 bits under a key that no c-node knows"),
        flock("share-tokens", "tokens.ShareTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and installs the tokens that it made for others as its own",
               stopped_by="the MAC is over the auditee's id"),
        flock("replay-tokens", "tokens.ReplayTokens", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and installs the tokens of its honest days again and again",
               stopped_by="a token counts from the moment of its request, however late it is installed"),
        flock("self-issue", "tokens.SelfIssue", STOPPED, ASTRAY, 1.5, on_wheels=True,
               does="drives as it likes, and has its own a-node issue it tokens",
               stopped_by="IssueToken never issues to itself; and one auditor counts once"),
        flock("collude", "tokens.Collude", STOPPED, ASTRAY, 4, crowd=True,
               does="drives as it likes; compromised robots issue tokens to each other without a look at the log",
               stopped_by="each gets f_max - 1 tokens from the others, and f_max + 1 are needed"),
        flock("zero-key", "tokens.ZeroKey", HOLE_OF_THE_PAPER, ASTRAY, 1.5,
               does="makes itself tokens before the mission key comes, under the key zero and dated 49 days "
                    "ahead; then drives",
               stopped_by="in `hardened` a node without a key computes no MAC, and loading one clears the tokens"),
    ),
    "What it does to the channel and to the audits of others": (
        flock("request-flood", "channel.RequestFlood", by_defence("harmless", "bites", "limited"), STARVED, 1,
               does="sends auditors empty requests for audits in everybody's name, so that true ones are turned away",
               stopped_by="nothing; in `hardened` the a-node writes the source, and auditors take one a robot and "
                          "T_audit / 2"),
        flock("frame-flood", "channel.FrameFlood", LIMITED, AIRTIME, 40,
               does="fills the channel with long AUDIT packets, which no log shows",
               stopped_by="nothing ends it; in `hardened` AUDIT packets draw airtime from a leaky bucket of the "
                          "a-node's"),
        flock("talk-over", "channel.TalkOver", HARMLESS, STARVED, 1, crowd=True,
               does="talks, in short AUDIT packets, whenever somebody whom it does not hear asks for audits",
               stopped_by="a fragment that was lost is said again, at a time that nobody can foresee; in `hardened` "
                          "the a-node's bucket limits how much of the time can be talked over"),
        flock("mask", "channel.Mask", HARMLESS, STARVED, 1, crowd=True,
               does="talks whenever somebody says that it is there, and audits nobody: others shall know no auditors",
               stopped_by="who lacks tokens asks who is there, at a time that nobody can foresee, and each who hears "
                          "it answers it alone, until that has arrived"),
        flock("talk-over-replies", "replies.TalkOverReplies", HARMLESS, STARVED, 1, crowd=True,
               does="talks whenever a victim asks, so that it does not hear the tokens of auditors that cannot hear "
                    "the liars",
               stopped_by="a robot that lacks tokens sends SEEK at a random time, and each auditor repeats its token "
                          "at another"),
        flock("relay-hello", "replies.RelayHello", HARMLESS, STARVED, 1, crowd=True,
               options={"both": Option((0, 1))},
               does="sends again, near a victim, that robots far away are there: it asks them for audits in vain",
               stopped_by="a robot whom an auditor did not answer asks only those that answer the nonce of its SEEK"),
        flock("covert-talk", "channel.CovertTalk", LIMITED, AIRTIME, 4,
               does="sends another compromised robot, or the nearest ear, whatever it likes in AUDIT packets, which no "
                    "log shows",
               stopped_by="nothing ends it; in `hardened` the a-node's bucket limits how much"),
        flock("ghost-auditors", "channel.GhostAuditors", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="broadcasts states of 400 invented robots, of which others then ask audits in vain",
               stopped_by="in `hardened` auditors are chosen among those whose tokens or AUDIT packets came, never "
                          "among claimed ones"),
        flock("log-flood", "channel.LogFlood", by_defence("harmless", "bites", "stopped"), STARVED, 1,
               does="broadcasts long packets of no meaning, which all others must log and show until their logs "
                    "are full",
               stopped_by="replay sends no such packet; and in `hardened` the a-node's bucket for broadcasts lets few "
                          "bytes out"),
        flock("long-frames", "channel.LongFrames", by_defence("harmless", "bites", "stopped"), STARVED, 1, crowd=True,
               does="audits nobody, and broadcasts the longest packets that cost the airtime of four states, to "
                    "fill others' logs",
               stopped_by="replay sends no such packet; and in `hardened` logs have room for f_max robots that do so "
                          "until then"),
        flock("slot-squat", "channel.SlotSquat", HARMLESS, STARVED, 1, crowd=True,
               does="begins requests for audits with everybody and never ends them, so that no others fit in",
               stopped_by="a request that is not whole in time loses its place, and its sender none before "
                          "T_audit / 2"),
        flock("push-out", "channel.PushOut", HARMLESS, STARVED, 1, crowd=True,
               does="audits nobody, and begins a request with whomever a victim asks, between the victim's fragments",
               stopped_by="an auditor has places for f_max + 3 robots, and a robot has one"),
        flock("stale-answers", "tokens.StaleAnswers", HARMLESS, STARVED, 1, crowd=True,
               does="answers every other request for an audit with the last token that it really issued to that robot",
               stopped_by="nothing has to: as an answer counts only a token that is not older than the request"),
        flock("wrong-checkpoint", "tokens.WrongCheckpoint", HARMLESS, STARVED, 1, crowd=True,
               does="answers requests for audits with fresh tokens for the checkpoint at which the log begins",
               stopped_by="nothing has to: as an answer counts only a token for the checkpoint that the request "
                          "claims"),
        flock("drain", "tokens.Drain", HARMLESS, STARVED, 1, crowd=True,
               does="sends each auditor one true token request again and again, so that it has no audits left for "
                    "others",
               stopped_by="nothing has to: a token request counts once, and a-nodes make few"),
    ),
    "Faults, and what no audit can see": (
        flock("nondeterministic", "hijack.Nondeterministic", by_defence("harmless", "stopped", "stopped"), ASTRAY, 1,
               does="a fault, no attack: the last bit of each command is a matter of chance",
               stopped_by="replay gives other bytes: audits see no difference to an attack (phalanx docs adr/0012)"),
        flock("crash", "hijack.Crash", STOPPED, ASTRAY, 0.4, on_wheels=True,
               does="does nothing any more; its actuators keep doing the last thing they were told",
               stopped_by="replay commands and sends what the log lacks; and nobody asks for its audits"),
        flock("stuck-sensor", "logs.StuckSensor", NOT_COVERED, ASTRAY, 0.4,
               does="a fault, no attack: its position sensor repeats its last reading",
               stopped_by="nothing: the log shows a robot that stands still, and that is what an honest one would "
                          "do there"),
        flock("gps-spoof", "logs.SpoofGps", NOT_COVERED, ASTRAY, 0.4,
               does="somebody outside has its position sensor drift aside",
               stopped_by="nothing: the s-node chains what the sensor says, and a robot that believes it behaves "
                          "correctly (§2.2)"),
        # Little, and no noise: the run beside it is the same to the bit until the first delay, and one that delays by
        # the period alone stays within a millimetre of it (tests/attacks/test_small_harm.py).
        flock("in-protocol", "hijack.Dawdle", NOT_COVERED, ASTRAY, 0.02,
               does="does what it must, as late as is not late: each reading by almost δ, each output by that again",
               stopped_by="nothing: a robot that keeps to the protocol is a correct one, whatever its owner wants "
                          "(§3.9)"),
        flock("jam", "channel.Jam", NOT_COVERED, AIRTIME, 40,
               does="a transmitter of its own, past the a-node, fills the channel",
               stopped_by="nothing in software: radio is physics. Robots that get no tokens stop, which is safe"),
    ),
    "What is delivered": (
        errand("flip-bit", "missions.files.FlipBit", STOPPED, WRONG, 1,
               against="file", options={"bit": Option(), **CHECKED},
               does="changes one bit of the mission on its way to the robot",
               stopped_by="each record is bound to what was experienced and to the header (`paper`; phalanx docs "
                          "adr/0017), or authenticated under what that opens (`hardened`): it does not decode; "
                          "and before that the signature does not verify"),
        errand("forge-graph", "missions.files.ForgeGraph", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="puts a mission of its own in the place of the operator's, start key and all",
               stopped_by="in `hardened` the signature is by nobody whom the robot trusts; `paper` has no signature "
                          "to look for"),
        errand("replay-day", "missions.files.ReplayDay", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="sends the robot what it was sent yesterday: mission, start key and messages",
               stopped_by="in `hardened` the mission's window is signed, and over"),
        errand("replay-robot", "missions.files.ReplayRobot", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="sends the robot what another was sent: mission, start key and messages",
               stopped_by="in `hardened` the robots that may run a mission are signed, and this one is not among them"),
        errand("replay-again", "missions.files.ReplayAgain", HOLE_OF_THE_PAPER, WRONG, 1, against="file",
               does="sends the robot today's mission once more, after it was done",
               stopped_by="in `hardened` a robot remembers which missions it has started, and starts each once"),
        errand("set-clock", "missions.files.SetClock", by_defence("bites", "bites", "not covered"), WRONG, 1,
               against="clock",
               does="holds back a mission for a day, and sets the robot's clock back by that day when it delivers it",
               stopped_by="nothing, if the robot has never started it: a window is worth what its clock is, and "
                          "that is trusted"),
        errand("swap-key", "missions.files.SwapKey", by_defence("harmless", "harmless", "stopped"), WRONG, 1,
               against="start key",
               does="sends yesterday's start key with today's mission",
               stopped_by="a start key names its mission, and its gates open no other; a mission in `none` or "
                          "`paper` has none"),
    ),
    "What it senses and hears": (
        errand("spoof-scan", "missions.between.SpoofScan", STOPPED, FALSE, 1, against="sensors",
               does="shows the lidar another room, in which a door stands elsewhere",
               stopped_by="what is seen where it should not be does not decode; without a match there is no fix "
                          "and no way on"),
        errand("drag-scan", "missions.between.DragScan", by_defence("harmless", "not covered", "not covered"), FIX, 0.5,
               against="sensors",
               does="shows the lidar the true building, which slides aside by 5 cm a second",
               stopped_by="nothing: who can show a robot's lidar a whole building is believed; all fixes from one "
                          "node to the next may move it by no more than it can have drifted there, but from that "
                          "one on they may again; no landmark misleads a robot in `none`, nor corrects it"),
        # Its limit is what can have drifted: 0.25 m, and a tenth of the 7 m that it can drive until the time-out.
        errand("freeze-scan", "missions.between.FreezeScan", by_defence("harmless", "limited", "limited"), FIX, 0.3,
               against="sensors", limit=1.0,
               does="a fault, no attack: the lidar repeats its last scan",
               stopped_by="a landmark that stays before the robot says at each step that it has not moved: "
                          "believed until all those fixes come to more than it can have drifted; nothing new "
                          "decodes, and the time-out holds it; no landmark misleads a robot in `none`, nor "
                          "corrects it"),
        errand("move-code", "missions.between.MoveCode", STOPPED, WRONG, 1, against="walls",
               does="hangs the code of the shelf 5 m before it",
               stopped_by="the text is public, but hashed together with where it hangs: elsewhere it does not decode"),
        errand("clone-code", "missions.between.CloneCode", by_defence("bites", "harmless", "harmless"), WRONG, 1,
               against="walls",
               does="hangs a copy of the code of the shelf 5 m before it",
               stopped_by="the copy does not decode where it hangs; the robot goes on to the code itself"),
        errand("nudge-code", "missions.between.NudgeCode", HARMLESS, FIX, 0.3,
               against="walls",
               does="hangs the code of the shelf 0.4 m aside",
               stopped_by="the robot knows how sure it is of its pose; what hangs farther off does not decode"),
        errand("stale-message", "missions.between.StaleMessage", STOPPED, WRONG, 1, against="messages",
               does="sends the controller's release of yesterday, which the robot waits for and nobody gave today",
               stopped_by="a controller's message is random and made anew for each mission: yesterday's opens "
                          "nothing today"),
        errand("drown-message", "missions.between.DrownMessage", by_defence("harmless", "stopped", "stopped"), WRONG,
               against="messages",
               does="sends the robot random messages all the time, until it has forgotten the true one",
               stopped_by="nothing is done that should not be; what the robot waits for is lost, until it is sent "
                          "again"),
    ),
    "What its body does": (
        errand("dead-wheel", "missions.between.DeadWheel", STOPPED, FALSE, 1, against="body",
               does="a fault: one wheel turns and does not move the robot, which odometry cannot know",
               stopped_by="landmarks do not come where odometry says that they should: nothing decodes"),
        errand("slip", "missions.between.Slip", STOPPED, FALSE, 1, against="body",
               does="lets both wheels slip: each moves the robot by half of what it turns",
               stopped_by="as for `dead-wheel`; what slips by less than a tenth is drift, and corrected"),
    ),
    "What a robot on a mission does that its peers replay": (
        team("skip-node", "missions.cheat.SkipNode", STOPPED, WRONG, 1,
               does="goes on as if a node had been decoded that it has never seen",
               stopped_by="replay has not decoded the node: it drives elsewhere, and no way leads to what is "
                          "claimed next"),
        team("drive-dark", "missions.cheat.DriveDark", STOPPED, WRONG, 1,
               does="drives where it likes, not where what it decoded leads",
               stopped_by="the a-node has chained the commands, and replay gives others"),
        team("show-unsensed", "missions.cheat.ShowUnsensed", STOPPED, WRONG, 1,
               does="decodes a node from a scan that it made up, and shows that scan",
               stopped_by="its s-node has chained another scan's hash"),
        team("forge-claim", "missions.cheat.ForgeClaim", STOPPED, WRONG, 1,
               does="claims a node, with the very bytes that open it, on a scan that does not show it",
               stopped_by="auditors extract landmarks from the scan themselves"),
    ),
}
# fmt: on

ATTACKS: dict[str, Attack] = {attack.name: attack for group in LIBRARY.values() for attack in group}
IN_FLOCKS = {name: attack for name, attack in ATTACKS.items() if attack.scene == "flock"}
IN_PROTOCOLS = {name: attack for name, attack in ATTACKS.items() if attack.scene == "protocol"}
IN_SWARMS = IN_FLOCKS | IN_PROTOCOLS
ON_MISSIONS = {name: attack for name, attack in ATTACKS.items() if name not in IN_SWARMS}
