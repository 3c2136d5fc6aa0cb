"""`phalanx link`: visit a swarm without a browser, and manage a gateway's visitors."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.options import implemented_by, option


@click.group(epilog="Example: phalanx link connect 'http://192.168.1.7:8080/#j=…'")
def link() -> None:
    """Visit a swarm from a terminal; invite, approve and remove visitors; read the audit trail."""


@link.command(
    epilog="Example: phalanx link connect 'http://192.168.1.7:8080/#j=…' --drive Ada --left 60 --right 60 --for 2"
)
@click.argument("qr_url", required=False)
@option("--pin", help="The pin, if you have no link. Other users of this machine can read it while the command runs.")
@option("--broker", help="Broker to connect to, mqtt(s):// or ws(s):// URL; replaces the one in the link.")
@options.root_option
@options.login_option
@option("--drive", help="Address or name of the robot to drive.", metavar="ROBOT")
@option("--unlisted", help="Allow --drive with an address that the swarm does not list.", is_flag=True)
@option("--left", help="Left wheel, percent.  [default: 0]", type=click.IntRange(-100, 100))
@option("--right", help="Right wheel, percent.  [default: 0]", type=click.IntRange(-100, 100))
@option("--for", "for_s", help="Seconds to drive.  [default: 1.0]", type=click.FloatRange(0, 3600))
@option("--watch", help="Print notifications until Ctrl-C.", is_flag=True)
@option("--name", help="Your nickname, unless the code or ticket sets one.", default="")
@option("--keep", help="File that stores the session, to resume it on the next visit.", type=options.OUT_FILE)
@option("--timeout", help="Seconds to wait.", type=click.FloatRange(0.1, 3600), default=10.0)
@options.json_option
@implemented_by("link", "connect")
def connect() -> None:
    """Visit a swarm: list its robots, drive one, or watch.

    QR_URL is the link under the QR code, in quotes; - reads it from standard input, hidden from other users.
    """


@link.command(epilog="Example: phalanx link invite --robot Ada --role driver --uses 1")
@option("--robot", "robots", help="Robot that the ticket lets visitors drive; repeatable. Default: any.", multiple=True)
@option(
    "--role",
    help="Role of visitors who use the ticket.",
    type=click.Choice(["watcher", "driver", "operator", "watch", "drive", "operate"]),
    default="driver",
)
@option("--uses", help="Number of visitors who can use the ticket.", type=click.IntRange(1, 1000), default=1)
@option("--name", help="Nickname of its visitors. Default: they choose.", default="")
@option("--hours", help="Hours that the ticket is valid.", type=click.FloatRange(0.01, 8784), default=168.0)
@option("--sheet", help="Write an HTML page with one card for each --robot, or for every robot.", type=options.OUT_FILE)
@options.state_option
@options.json_option
@implemented_by("invite", "invite")
def invite() -> None:
    """Create a ticket at a running gateway and print its link, or create a sheet with a ticket for each robot."""


@link.command(epilog="Example: phalanx link people")
@options.state_option
@options.json_option
@implemented_by("people", "people")
def people() -> None:
    """List the visitors of a running gateway: connected ones, and those who can return."""


@link.command(epilog="Example: phalanx link kick Ada")
@click.argument("name", required=False)
@option("--everybody", help="Remove all visitors except operators.", is_flag=True)
@options.state_option
@options.json_option
@implemented_by("people", "kick")
def kick() -> None:
    """Remove a visitor permanently; NAME is the visitor's name or number.

    The visitor's session and ticket and the code on the screen become invalid at once. New visitors then wait for
    approval, because the same person could scan the new code.
    """


@link.command(epilog="Examples: phalanx link approve Ada; phalanx link approve Bob --watch")
@click.argument("name", required=False)
@option("--everybody", help="Approve all who wait, and all new visitors from now on.", is_flag=True)
@option("--watch/--drive", "watches", help="Allow the visitor to watch only, or to drive again.", default=None)
@options.state_option
@options.json_option
@implemented_by("people", "approve")
def approve() -> None:
    """Admit a waiting visitor; NAME is the visitor's name or number."""


@link.command(epilog="Examples: phalanx link assign Ada Rosa; phalanx link assign Ada --none")
@click.argument("name")
@click.argument("robot", required=False)
@option("--none", help="Release the robot that the visitor has.", is_flag=True)
@options.state_option
@options.json_option
@implemented_by("people", "assign")
def assign() -> None:
    """Assign a robot to a visitor until it is released; NAME is a visitor's name or number, ROBOT a name or address."""


@link.command(epilog="Example: phalanx link revive Ada")
@click.argument("robot")
@options.state_option
@options.json_option
@implemented_by("revive", "revive")
def revive() -> None:
    """Restart a stopped simulated robot, with its honest controller; ROBOT is its name or address.

    A real robot has to be restarted by hand, with a new mission key.
    """


@link.group(epilog="Example: phalanx link trail verify")
def trail() -> None:
    """Export or check the audit trail: who joined, drove, was refused and was removed."""


@trail.command(epilog="Example: phalanx link trail export > trail.jsonl")
@click.argument("file", required=False, type=options.FILE)
@options.state_option
@implemented_by("invite", "export")
def export() -> None:
    """Print the trail, one JSON object per line. Exit with 2 at the first line that was changed."""


@trail.command(epilog="Example: phalanx link trail verify --top HASH")
@click.argument("file", required=False, type=options.FILE)
@options.state_option
@option("--top", help="Hash that an earlier check printed. If the trail lacks it, its end was cut off.", metavar="HASH")
@implemented_by("invite", "verify")
def verify() -> None:
    """Check that no line of the trail was changed or removed, and print the hash of the last line."""
