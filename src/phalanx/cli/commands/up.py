"""`phalanx up`: run a gateway for visitors."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.complete import a_map, a_mission_or_encoded
from phalanx.cli.options import FILE, FOLDER, PORT, SECONDS, implemented_by, option

ROBOTS, ROBOTS_ON_MISSION = 12, 4


@click.command(
    epilog="Examples: phalanx up --host 0.0.0.0 --robots 20; phalanx up --mission office;"
    " phalanx up --swarm dotbot://127.0.0.1:8000"
)
@option("--robots", help=f"Simulated robots.  [default: {ROBOTS}; on a mission {ROBOTS_ON_MISSION}]", type=int)
@option(
    "--swarm",
    "swarm_url",
    help="Real robots instead: those listed in a file (phalanx docs guides/robot), in a ROS 2 domain (phalanx docs"
    " guides/ros2), or behind PyDotBot's controller (phalanx docs guides/dotbots). --wait sets how long to wait for the"
    " last two.",
    metavar="FILE.yaml|ros2|dotbot://HOST:PORT",
)
@option(
    "--scenario",
    "protocol",
    help="Task of simulated robots that nobody drives: exploration, patrol, perimeter or tracking"
    " (phalanx docs guides/protocols); none: stand still.  [default: patrol, if at most 40 robots"
    " audit each other]",
    metavar="NAME",
)
@option(
    "--revive",
    "revive_s",
    help="Restart a stopped simulated robot after this many seconds, with its honest controller. Default: only on"
    " request, by phalanx link revive or on the operator's page.",
    type=SECONDS,
)
@option(
    "--tour",
    help="Demonstrate the three shields in turn, a minute each, with captions on the projector's page: a visitor"
    " drives, robots decode a mission, a compromised robot is stopped and revived.",
    is_flag=True,
)
@option("--seed", help="Seed of the robots' places and batteries.", default=0)
@option(
    "--mission",
    "missions",
    help="Mission that the robots run while visitors watch; the operator's page has an editor for others."
    " Repeatable, for the FILEs of its parts.",
    multiple=True,
    metavar="FILE|BUILTIN",
    shell_complete=a_mission_or_encoded,
)
@options.furnish_option
@option(
    "--world",
    help="The building of the mission. Default: the one that the mission names. Without --mission, robots wait in it"
    " for a mission. Your own building: phalanx docs guides/maps.",
    metavar="NAME|FILE",
    shell_complete=a_map,
)
@option("--start-key", help="Start key of a sealed --mission FILE. Default: FILE.key.", type=FILE)
@option("--trust", help="Refuse a --mission FILE that no such key signed; repeatable.", multiple=True, metavar="KEY")
@options.defence_option(
    help="Defence against compromised robots: audits (hardened), audits as in the paper (paper), or none."
    "  [default: hardened, for up to 100 robots]"
)
@option(
    "--f-max",
    help="Number of compromised robots that are tolerated. With fewer than 2 f_max + 3 robots, compromised robots can"
    " cause others to be stopped.  [default: 3, or fewer for few robots]",
    type=click.IntRange(1, 15),
)
@option(
    "--keys",
    help="Key file of phalanx keys for simulated robots. Each start uses up one mission number; robots 1 to --robots"
    " need a master key.",
    type=FILE,
)
@options.passphrase_option
@option("--host", help="Address to listen on for visitors; 0.0.0.0: all interfaces.", default="127.0.0.1")
@option("--port", help="Port of the visitors' page.  [default: 8080, or any free port]", type=PORT)
@option("--tls", help="Serve https with this certificate and key (PEM files).", type=(FILE, FILE), metavar="CERT KEY")
@option(
    "--behind-proxy",
    help="The gateway is behind a reverse proxy: take visitors' addresses from X-Forwarded-For (phalanx docs"
    " guides/https).",
    is_flag=True,
)
@option(
    "--assign",
    help="Assignment of robots to visitors: first come, first served (free); one visitor each, in turns (one-each); or"
    " the visitor whose ticket names the robot (tickets).",
    type=click.Choice(["free", "one-each", "tickets"]),
    default="free",
)
@option("--turn", "turn_s", help="With one-each: seconds of a turn while others wait.", type=SECONDS, default=120.0)
@option(
    "--state",
    help="Folder that stores visitors, tickets and the trail across restarts."
    "  [default: ~/.local/state/phalanx, unless another gateway uses it]",
    type=FOLDER,
)
@option(
    "--wifi",
    "wifi_ssid",
    help="Show a QR code to join this Wi-Fi network, in the terminal and on the projector's page.",
    metavar="SSID",
)
@option(
    "--wifi-password-file",
    help="File whose first line is that network's password. Default: the network is open.",
    type=FILE,
)
@option("--operator-port", help="Port of the operator's page; 0: any free port.", type=PORT, default=0)
@option(
    "--operator-token-file",
    help="File that stores the operator's token: with --operator-port, an open operator's page still works after a"
    " restart. FILE.stopped beside it stores the operator's stop.",
    type=FILE,
)
@option(
    "--page-url",
    help="Address of the visitors' page, if it is not this machine's, such as that of an https proxy.",
    default="",
)
@option(
    "--broker",
    help="MQTT broker for visitors who cannot reach this machine: a mqtt(s):// or ws(s):// URL, or mosquitto to start"
    " one. Its operator can neither read messages nor drive robots.",
    default="",
    metavar="mosquitto|URL",
)
@options.broker_ws_option
@options.login_option
@option(
    "--qrkey",
    help="Also serve clients of the published Qrkey through the broker: all their visitors share one key (phalanx docs"
    " guides/qrkey). --pin-digits, --rotate-s, --overlap-s and --frontend apply to it.",
    is_flag=True,
)
@options.link_options
@option(
    "--frontend",
    help="URL of a Qrkey page that the code opens instead of ours. The server of that page can read the pin.",
    default="",
)
@options.wait_option
@options.duration_option
@option(
    "--events",
    help="Print events as JSON, one per line, instead of a QR code. The first is 'ready', or 'waiting' while the broker"
    " is unreachable; at_s is the time.",
    is_flag=True,
)
@implemented_by("up", "up")
def up() -> None:
    """Run a gateway: a swarm, the visitors' page and its QR code. Nothing else has to be installed.

    Press Enter to stop all robots at once, even if the network fails. Type go and Enter to let them move again. With
    --events, send the lines stop and go on stdin. The operator's page has the same buttons. Ctrl-C ends the gateway.
    """
