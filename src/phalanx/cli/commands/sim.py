"""`phalanx sim`: run and view scenarios, list the bundled ones, and check controllers."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.complete import a_controller, a_scenario, a_scenario_or_recording, an_attack_by_robots
from phalanx.cli.options import PORT, combine_options, implemented_by, option
from phalanx.scenarios.scenario import CONTROLLERS

# Options that change a scenario.
chosen_options = combine_options(
    options.swarm_options,
    options.defence_option(help="none; paper: as published; hardened: with our corrections."),
    option(
        "--attack",
        "attacks",
        help="Attack by one robot, replaces the scenario's; repeatable. none: no robot is compromised.",
        multiple=True,
        shell_complete=an_attack_by_robots,
        metavar="NAME|FILE.py:CLASS[:robot=I,at=T,…]",
    ),
    options.controller_option,
    options.planner_option,
)


@click.group(epilog="Example: phalanx sim run bti-fig9 --record fig9.mcap")
def sim() -> None:
    """Simulate a swarm whose robots audit each other."""


@sim.command(
    epilog="Examples: phalanx sim run bti-fig9 --attack spoof:robot=7,at=20 --duration 60; "
    "phalanx sim run bti-fig9 --trace robot=5; phalanx docs reference/scenarios describes the files"
)
@click.argument("scenario", shell_complete=a_scenario)
@chosen_options
@options.record_option
@option("--trace", help="Print each event and action of one robot; repeatable.", metavar="robot=I", multiple=True)
@option("--plain", help="Use the plain implementation: slower, with the same digest.", is_flag=True)
@options.json_option
@implemented_by("sim", "run")
def run() -> None:
    """Run SCENARIO, a built-in name or a YAML file, and print a summary.

    The same scenario and seed give the same digest. Exit with 1 if a correct robot was stopped although it had a
    quorum: f_max + 2 correct robots in range. The same holds for runs with a jammer, which has no defence.
    """


@sim.command(epilog="Examples: phalanx sim view bti-fig9; phalanx sim view fig9.mcap --port 8090")
@click.argument("source", metavar="FILE.mcap|SCENARIO", shell_complete=a_scenario_or_recording)
@chosen_options
@option("--port", help="Port of the page, on this machine only; 0: any free port.", type=PORT, default=0)
@implemented_by("view", "view")
def view() -> None:
    """Show a recording, or SCENARIO while it runs, in the browser: map, tokens and refusals.

    Print the page's address and serve the page to this machine until Ctrl-C. Recordings of missions are also shown.
    """


@sim.command("list", epilog="Example: phalanx sim list --json")
@options.json_option
@implemented_by("lists", "list_scenarios")
def list_scenarios() -> None:
    """List the bundled scenarios."""


@sim.command(epilog="Example: phalanx sim schema > scenario.schema.json")
@implemented_by("lists", "print_schema")
def schema() -> None:
    """Print the JSON schema of scenario files, for editors."""


@sim.command(epilog="Examples: phalanx sim check flock; phalanx sim check my_flock.py")
@click.argument("controller", metavar="|".join(("FILE.py[:CLASS]", *CONTROLLERS)), shell_complete=a_controller)
@option("--seed", help="Seed of the controller's inputs.", type=click.IntRange(0, (1 << 32) - 1), default=0)
@options.json_option
@implemented_by("sim", "check")
def check() -> None:
    """Check that a controller gives the same outputs for the same inputs, and print where it does not.

    An auditor replays a robot's controller; if the outputs differ, the robot is stopped. So this command makes the same
    calls in four processes, with different clocks, time zones and set orders, compiled and not, and from each
    checkpoint. Some packets and readings are malformed. Exit with 1 if any byte differs, if the controller raises, or
    if an output is invalid, such as NaN. Calls that sleep, open a file, start a thread or take 10 s are errors.
    """
