"""`rrins bench`: measure the cost of a rehearsal on this machine."""

from __future__ import annotations

import json

import click

from rrins.host_tools.cli.options import flag, json_option
from rrins.host_tools.interruption import heed_sigterm


@click.command()
@json_option
@flag("--quick", "Fewer samples, no cold start: about 20 s.")
def bench(as_json: bool, quick: bool) -> None:
    """Measure what a rehearsal costs on this machine: speed, steps, codec, lateness, startup."""
    from rrins.host_tools.benchmarks.suite import measured, print_result
    from rrins.host_tools.terminal import new_console

    heed_sigterm()
    result = measured(quick)
    if as_json:
        click.echo(json.dumps(result))
    else:
        print_result(result, new_console())
