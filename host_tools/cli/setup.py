"""`rrins setup`: what a navigation computer is set up with, for a program of one's own."""

from __future__ import annotations

import click

from rrins.host_tools.cli.options import scenario_argument
from rrins.host_tools.scenario.scenario import load


@click.command()
@scenario_argument
def setup(scenario: str) -> None:
    """Show the set-up of SCENARIO's navigation computer: a key and its values on each line.

    `rrins rehearse --firmware PROGRAM` gives it to PROGRAM as a file.
    """
    from rrins.host_tools.runs.set_up.setup_file import setup_text

    click.echo(setup_text(load(scenario)), nl=False)
