"""`phalanx link`: a visitor and a server without a browser."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.options import option, runs


@click.group(epilog="Example: phalanx link connect 'http://192.168.1.7:8080/#j=…'")
def link() -> None:
    """Visit a swarm from a terminal; invite, approve and remove visitors; see who drove."""


@link.command(
    epilog="Example: phalanx link connect 'http://192.168.1.7:8080/#j=…' --drive Ada --left 60 --right 60 --for 2"
)
@click.argument("qr_url", required=False)
@option("--pin", help="The pin, if you have no link; every user of this machine can read it while this runs.")
@option("--broker", help="Where to connect: mqtt(s):// or ws(s):// URL; with a link, instead of the one in it.")
@options.root_option
@options.login_option
@option("--drive", help="Drive this robot: its address or its name.", metavar="ROBOT")
@option("--unlisted", help="--drive an address that the swarm does not list.", is_flag=True)
@option("--left", help="Left wheel, percent.  [default: 0]", type=click.IntRange(-100, 100))
@option("--right", help="Right wheel, percent.  [default: 0]", type=click.IntRange(-100, 100))
@option("--for", "for_s", help="Seconds to drive.  [default: 1.0]", type=click.FloatRange(0, 3600))
@option("--watch", help="Print notifications as they come, until Ctrl-C.", is_flag=True)
@option("--name", help="Nickname, if the code or ticket leaves it to you.", default="")
@option("--keep", help="File to keep the session in: the next visit is the same visitor's.", type=options.OUT_FILE)
@option("--timeout", help="Seconds to wait.", type=click.FloatRange(0.1, 3600), default=10.0)
@options.json_option
@runs("link", "connect")
def connect() -> None:
    """Visit a swarm: list its robots, drive one, or watch.

    QR_URL is the link under the QR code, in quotes; - reads it from standard input, where nobody else sees it.
    """


@link.command(epilog="Example: phalanx link invite --robot Ada --role driver --uses 1")
@option("--robot", "robots", help="That its visitors may drive; repeatable. Without: any.", multiple=True)
@option(
    "--role",
    help="What its visitors may do.",
    type=click.Choice(["watcher", "driver", "operator", "watch", "drive", "operate"]),
    default="driver",
)
@option("--uses", help="For so many visitors.", type=click.IntRange(1, 1000), default=1)
@option("--name", help="Its visitors are called that; without, they choose.", default="")
@option("--hours", help="For how long it is valid.", type=click.FloatRange(0.01, 8784), default=168.0)
@option("--sheet", help="Write a page with a card for each --robot, or for every robot.", type=options.OUT_FILE)
@options.state_option
@options.json_option
@runs("invite", "invite")
def invite() -> None:
    """Make a ticket for a gateway that runs, and print its link; or a sheet of tickets, a card for each robot."""


@link.command(epilog="Example: phalanx link people")
@options.state_option
@options.json_option
@runs("people", "people")
def people() -> None:
    """List the visitors of a gateway that runs: who is connected and since when, and who may come back."""


@link.command(epilog="Example: phalanx link kick Ada")
@click.argument("name", required=False)
@option("--everybody", help="All but operators.", is_flag=True)
@options.state_option
@options.json_option
@runs("people", "kick")
def kick() -> None:
    """Remove a visitor for good; NAME is its name or number.

    Its session, its ticket and the code on the screen are refused at once. Newcomers wait until they are approved, as
    the same person may scan the new code.
    """


@link.command(epilog="Examples: phalanx link approve Ada; phalanx link approve Bob --watch")
@click.argument("name", required=False)
@option("--everybody", help="All who wait, and newcomers from now on.", is_flag=True)
@option("--watch/--drive", "watches", help="Allow it watching only, or driving again.", default=None)
@options.state_option
@options.json_option
@runs("people", "approve")
def approve() -> None:
    """Let a visitor in that waits; NAME is its name or number."""


@link.command(epilog="Examples: phalanx link assign Ada Rosa; phalanx link assign Ada --none")
@click.argument("name")
@click.argument("robot", required=False)
@option("--none", help="Take the robot that it has.", is_flag=True)
@options.state_option
@options.json_option
@runs("people", "assign")
def assign() -> None:
    """Give a visitor a robot until it is taken; NAME is its name or number, ROBOT a name or address."""


@link.command(epilog="Example: phalanx link revive Ada")
@click.argument("robot")
@options.state_option
@options.json_option
@runs("revive", "revive")
def revive() -> None:
    """Have a stopped robot of the simulation begin anew, honest; ROBOT is its name or address.

    A real robot is revived by hand, with a new mission key.
    """


@link.group(epilog="Example: phalanx link trail verify")
def trail() -> None:
    """Who joined, drove, was refused and was removed."""


@trail.command(epilog="Example: phalanx link trail export > trail.jsonl")
@click.argument("file", required=False, type=options.FILE)
@options.state_option
@runs("invite", "export")
def export() -> None:
    """Print the trail, a JSON object a line; end with 2 at the first line that was changed."""


@trail.command(epilog="Example: phalanx link trail verify --top HASH")
@click.argument("file", required=False, type=options.FILE)
@options.state_option
@option("--top", help="A hash that was printed before: it has to be in it, or the end was cut off.", metavar="HASH")
@runs("invite", "verify")
def verify() -> None:
    """Check that no line of the trail was changed or taken out, and print the hash of the last."""
