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
    help="Real robots instead: those that a file lists (phalanx docs guides/robot), those of a ROS 2 domain (phalanx"
    " docs guides/ros2), or DotBots behind PyDotBot's controller (phalanx docs guides/dotbots). --wait says how long to"
    " wait for the last two.",
    metavar="FILE.yaml|ros2|dotbot://HOST:PORT",
)
@option(
    "--scenario",
    "protocol",
    help="What simulated robots do while nobody drives them: exploration, patrol, perimeter or tracking"
    " (phalanx docs guides/protocols); none: stand still.  [default: patrol, if at most 40 robots"
    " audit each other]",
    metavar="NAME",
)
@option(
    "--revive",
    "revive_s",
    help="Restart a stopped simulated robot after this many seconds, with its honest controller. Default: only by hand,"
    " with phalanx link revive or on the operator's page.",
    type=SECONDS,
)
@option(
    "--tour",
    help="Show the three shields in turn, a minute each, with captions on the projector's page: a visitor drives,"
    " robots decode a mission, a compromised robot is stopped and revived.",
    is_flag=True,
)
@option("--seed", help="Seed of the robots' places and batteries.", default=0)
@option(
    "--mission",
    "missions",
    help="Robots run this mission, and visitors watch; the operator's page has an editor for others."
    " Repeatable, for the FILEs of its parts.",
    multiple=True,
    metavar="FILE|BUILTIN",
    shell_complete=a_mission_or_encoded,
)
@options.furnish_option
@option(
    "--world",
    help="The building of the mission. Default: the one that the mission names. Without --mission: robots wait there"
    " for one. Your own building: phalanx docs guides/maps.",
    metavar="NAME|FILE",
    shell_complete=a_map,
)
@option("--start-key", help="Start key of a sealed --mission FILE. Default: FILE.key.", type=FILE)
@option("--trust", help="Refuse a --mission FILE none of these signed; repeatable.", multiple=True, metavar="KEY")
@options.defence_option(
    help="Defence against compromised robots: audits (hardened), audits as in the paper (paper), or none."
    "  [default: hardened, for up to 100 robots]"
)
@option(
    "--f-max",
    help="How many compromised robots are tolerated. With fewer than 2 f_max + 3 robots, compromised ones may have"
    " others stopped.  [default: 3, or fewer for few robots]",
    type=click.IntRange(1, 15),
)
@option(
    "--keys",
    help="Use the keys of this file of phalanx keys for simulated robots. It uses up one mission number; robots 1 to"
    " --robots need a master key.",
    type=FILE,
)
@options.passphrase_option
@option("--host", help="Address to listen on for visitors; 0.0.0.0 for all.", default="127.0.0.1")
@option("--port", help="Port of the visitors' page.  [default: 8080, or any free one]", type=PORT)
@option("--tls", help="Serve https with this certificate and key, PEM files.", type=(FILE, FILE), metavar="CERT KEY")
@option(
    "--behind-proxy",
    help="Behind your own reverse proxy: take visitors' addresses from X-Forwarded-For (phalanx docs guides/https).",
    is_flag=True,
)
@option(
    "--assign",
    help="Who drives a robot: whoever takes it first (free); one visitor each, in turns (one-each); or the visitor"
    " whose ticket names it (tickets).",
    type=click.Choice(["free", "one-each", "tickets"]),
    default="free",
)
@option("--turn", "turn_s", help="With one-each: seconds of a turn while others wait.", type=SECONDS, default=120.0)
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
@option(
    "--wifi-password-file",
    help="File whose first line is that network's password. Default: the network is open.",
    type=FILE,
)
@option("--operator-port", help="Port of the operator's page; 0: any free one.", type=PORT, default=0)
@option(
    "--operator-token-file",
    help="Keep the operator's token in this file: with --operator-port, an open operator's page still works after a"
    " restart. FILE.stopped beside it keeps the operator's stop.",
    type=FILE,
)
@option(
    "--page-url",
    help="Address of the visitors' page, if it is not this machine's, as behind an https proxy.",
    default="",
)
@option(
    "--broker",
    help="MQTT broker for visitors who cannot reach this machine: a mqtt(s):// or ws(s):// URL, or mosquitto to start"
    " one. Whoever runs it cannot read or drive.",
    default="",
    metavar="mosquitto|URL",
)
@options.broker_ws_option
@options.login_option
@option(
    "--qrkey",
    help="Also serve pages and programs of the published Qrkey, at the broker: all visitors share one key there"
    " (phalanx docs guides/qrkey). --pin-digits, --rotate-s, --overlap-s and --frontend are for it.",
    is_flag=True,
)
@options.link_options
@option(
    "--frontend",
    help="Show the code of this page of the published kind instead of ours. Whoever serves it can read the pin.",
    default="",
)
@options.wait_option
@options.duration_option
@option(
    "--events",
    help="Print events as JSON, one a line, instead of a QR code. The first is 'ready', or 'waiting' while there is no"
    " broker; at_s is the time.",
    is_flag=True,
)
@runs("up", "up")
def up() -> None:
    """Run a gateway: a swarm, the visitors' page and its QR code. Nothing else has to be installed.

    Press Enter to stop all robots at once, also when the network fails. Type go and Enter to let them move again.
    With --events, send lines with stop and go on stdin. The operator's page has the same button. Ctrl-C ends it.
    """
