"""`rrins bench`: measure the cost of a rehearsal on this machine."""

from __future__ import annotations

import click

from rrins.host_tools.interruption import heed_sigterm


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("--quick", is_flag=True, help="Fewer samples, no cold start: about 20 s.")
def bench(as_json: bool, quick: bool) -> None:
    """Measure what a rehearsal costs on this machine: speed, steps, codec, lateness, startup."""
    from rrins.host_tools.benchmarks import suite

    heed_sigterm()
    suite.bench(quick, as_json)
