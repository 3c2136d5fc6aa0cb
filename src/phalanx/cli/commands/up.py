"""`phalanx up`."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.complete import a_map, a_mission_or_encoded
from phalanx.cli.options import FILE, FOLDER, PORT, SECONDS, option, runs

ROBOTS, ROBOTS_ON_MISSION = 12, 4


@click.command(
    epilog="Examples: phalanx up --host 0.0.0.0 --robots 20; phalanx up --mission office;"
    " phalanx up --swarm dotbot://127.0.0.1:8000"
)
@option("--robots", help=f"Simulated robots.  [default: {ROBOTS}; on a mission {ROBOTS_ON_MISSION}]", type=int)
@option(
    "--swarm",
    "swarm_url",
    help="Real robots instead: those of a file, which obey signed orders (docs/guides/robot.md), those of a ROS 2"
    " domain (docs/guides/ros2.md), or DotBots, behind PyDotBot's controller there (docs/guides/dotbots.md)."
    " The last two are waited for as long as a broker.",
    metavar="FILE.yaml|ros2|dotbot://HOST:PORT",
)
@option(
    "--scenario",
    "protocol",
    help="What simulated robots do while nobody drives them: exploration, patrol, perimeter or tracking"
    " (docs/guides/protocols.md); none: stand still, and avoid nobody.  [default: patrol, of at most 40 robots that"
    " audit each other]",
    metavar="NAME",
)
@option(
    "--revive",
    "revive_s",
    help="Simulated robots that were stopped begin anew after so many seconds, honest. Without: by hand, with phalanx"
    " link revive or on the operator's page.",
    type=SECONDS,
)
@option(
    "--tour",
    help="Show the three shields, a minute each, with captions on the projector's page, again and again: a visitor"
    " drives, robots decode a mission, one that lies is stopped and revived.",
    is_flag=True,
)
@option("--seed", help="Of the robots' places and batteries.", default=0)
@option(
    "--mission",
    "missions",
    help="Robots live this mission, and are not driven; the operator's page has an editor for others."
    " Repeatable, for the FILEs of its parts.",
    multiple=True,
    metavar="FILE|BUILTIN",
    shell_complete=a_mission_or_encoded,
)
@options.furnish_option
@option(
    "--world",
    help="The building in which robots live missions; without, the one the mission names. Alone: they wait for one."
    " One of your own: docs/guides/maps.md.",
    metavar="NAME|FILE",
    shell_complete=a_map,
)
@option("--start-key", help="Of one sealed --mission FILE; without, FILE.key.", type=FILE)
@option("--trust", help="Refuse a --mission FILE none of these signed; repeatable.", multiple=True, metavar="KEY")
@options.defence_option(
    help="Defence against compromised robots: audits (hardened), audits as printed (paper), or none."
    "  [default: hardened, for up to 100 robots; on a mission, where an audit can show what they read]"
)
@option(
    "--f-max",
    help="The most compromised robots that are tolerated; of at least 2 f_max + 3 robots, or f_max of them may have"
    " others stopped.  [default: 3, or what so few robots allow]",
    type=click.IntRange(1, 15),
)
@option(
    "--keys",
    help="File of phalanx keys: what simulated robots' trusted nodes and their station have is the swarm's own, and a"
    " number of its missions is used up. Robots 1 to --robots are to have a master key.",
    type=FILE,
)
@options.passphrase_option
@option("--host", help="Address to listen on for visitors; 0.0.0.0 for all.", default="127.0.0.1")
@option("--port", help="Of the visitors' page and its websocket.  [default: 8080, or any free one]", type=PORT)
@option("--tls", help="Speak https: files of a certificate and its key, PEM.", type=(FILE, FILE), metavar="CERT KEY")
@option(
    "--behind-proxy",
    help="A proxy of yours is before us, and adds visitors' addresses as X-Forwarded-For (docs/guides/https.md).",
    is_flag=True,
)
@option(
    "--assign",
    help="Who drives a robot: whoever takes it first (free), the visitor that it is given to, with turns (one-each), or"
    " whom a ticket names it for (tickets).",
    type=click.Choice(["free", "one-each", "tickets"]),
    default="free",
)
@option("--turn", "turn_s", help="Seconds with a robot while others wait, with one-each.", type=SECONDS, default=120.0)
@option(
    "--state",
    help="Folder of visitors, tickets and the trail; a restart keeps them."
    "  [default: ~/.local/state/phalanx, unless another gateway has it]",
    type=FOLDER,
)
@option(
    "--wifi",
    "wifi_ssid",
    help="Show a code by which phones join this Wi-Fi network, on the terminal and the projector's page.",
    metavar="SSID",
)
@option("--wifi-password-file", help="Its password, the first line of a file; without, the network is open.", type=FILE)
@option("--operator-port", help="Of the operator's page; 0 is any free one.", type=PORT, default=0)
@option(
    "--operator-token-file",
    help="Keeps the operator's token, for its owner alone: with --operator-port a restart leaves an open page useful."
    " Beside it, FILE.stopped keeps the operator's stop: robots that were stopped stay so.",
    type=FILE,
)
@option("--page-url", help="Where visitors find our page, if not here: behind an https proxy, say.", default="")
@option(
    "--broker",
    help="For visitors who do not reach this machine: mosquitto, which is started, or a mqtt(s):// or ws(s):// URL."
    " Whoever runs it reads and drives nothing.",
    default="",
    metavar="mosquitto|URL",
)
@options.broker_ws_option
@options.login_option
@option(
    "--qrkey",
    help="Serve published pages and programs at the broker, too: all who have one code share it. The code that is shown"
    " stays the sessions', unless --frontend names a page. For this mode are the options below, but --root, --wait,"
    " --duration and --events.",
    is_flag=True,
)
@options.link_options
@option(
    "--frontend",
    help="Send visitors to this page of the published kind instead of ours; its host reads the pin.",
    default="",
)
@options.wait_option
@options.duration_option
@option(
    "--events",
    help="Print a JSON object a line instead of a QR code, at_s in each is its time; the first is 'ready' ('waiting'"
    " while there is no broker).",
    is_flag=True,
)
@runs("up", "up")
def up() -> None:
    """Run a gateway: a swarm, the visitors' page and its QR code. Nothing else has to be installed.

    Enter stops all robots at once, whatever becomes of the network, and the word go with Enter lets them move again; so
    do lines with stop and go on stdin of --events, and the operator's page. Ctrl-C ends it.
    """
