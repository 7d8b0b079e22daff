"""`rrins fmeda`: what becomes of a unit's failures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    POSITIVE,
    flag,
    json_option,
    option,
    seed_option,
    workers_option,
)
from rrins.host_tools.cli.output import make_folder, print_results, stepping, stopping

if TYPE_CHECKING:
    from rich.table import Table as Shown

    from rrins.host_tools.integrity.fmeda.table import Row, Table


@click.command()
@click.argument("scenario", default="drive_outage", shell_complete=complete_scenarios)
@option(
    "--rates", "TOML file with the failure modes and their rates.  [default: the example]", FILE
)
@flag("--show-rates", "Print the example of that file, and stop.")
@option("--runs", "Runs of each mode, part and phase.", click.IntRange(1, 100_000), 3)
@seed_option("the first run")
@option(
    "--window window_s",
    "Follow a failure for up to this many seconds.",
    click.IntRange(1, 100_000),
    300,
)
@option(
    "--alert alert_m",
    "Horizontal error that is dangerous, m.  [default: the scenario's alert limit]",
    POSITIVE,
)
@workers_option
@option("--out", "Folder for page, CSV and the worst runs.", FOLDER, Path("out/fmeda"))
@json_option
def fmeda(
    scenario: str,
    rates: Path | None,
    show_rates: bool,
    runs: int,
    seed: int,
    window_s: int,
    alert_m: float | None,
    workers: int | None,
    out: Path,
    as_json: bool,
) -> None:
    """Show which failures are detected, isolated, latent or dangerous, weighted by their rates.

    Each failure mode befalls each part of SCENARIO in each phase; without one, SCENARIO is
    drive_outage. Writes report.html, fmeda.csv and the scenarios of the worst runs. Ctrl-C keeps
    what is done.
    """
    from rrins.host_tools.campaigns.engines import processors
    from rrins.host_tools.integrity.fmeda.rates import default_text, load
    from rrins.host_tools.integrity.fmeda.study import Fmeda
    from rrins.host_tools.scenario import scenario as scenarios

    if show_rates:
        click.echo(default_text(), nl=False)
        return
    loaded = scenarios.load(scenario)
    limit_m = loaded.integrity.horizontal_alert_m if alert_m is None else alert_m
    study = Fmeda(scenario, loaded, load(rates), limit_m, runs, seed, window_s)
    make_folder(out)
    with stopping() as stop:
        with stepping("failures", len(study.trials)) as on_done:
            study.run(workers or processors(), stop, on_done)
        if not study.findings:
            return
        page, table_file = map(str, study.write(out))
        parts: list[Shown | str] = [_modes(study.table), _parts(study.table)]
        if study.left_out:
            parts.append(f"not in this scenario: {', '.join(study.left_out)}")
        done = f"{len(study.findings)} of {len(study.trials)} runs"
        worst = study.table.unit.worst.trial
        path = out / "worst" / f"{worst.mode.name}-{worst.part}-{worst.phase}.toml"
        parts += [f"{done}; the worst: rrins simulate {path}", page, table_file]
        values = study.values() | {"report": page, "csv": table_file, "worst": str(path)}
        print_results(as_json, values, parts)


def _modes(table: Table) -> Shown:
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.integrity.fmeda.table import DELAYS, HALF, MOST, SHARES
    from rrins.host_tools.integrity.words import percent
    from rrins.host_tools.terminal import new_table

    heads = [f"{name.replace('_', chr(10))}\n/ %" for name in SHARES]
    heads += [f"{name}\n/ s" for name in DELAYS]
    shape = new_table(
        "Failures by mode: shares; delays of half / 95 %", "mode", *heads, "effect\n/ m"
    )

    def add(name: str, row: Row, is_last: bool = False) -> None:
        shares = (percent(share, has_interval=False) for share in row.shares.values())
        delays = (
            f"{shown(row.quantile(value, HALF))} / {shown(row.quantile(value, MOST))}"
            for value in DELAYS.values()
        )
        largest = shown(max(one.effect_m for one in row.findings))
        shape.add_row(name, *shares, *delays, largest, end_section=is_last)

    rows = list(table.by_mode.items())
    for name, row in rows:
        add(name, row, name == rows[-1][0])
    add("unit", table.unit)
    return shape


def _parts(table: Table) -> Shown:
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.integrity.words import percent
    from rrins.host_tools.terminal import new_table

    heads = ("all", "safe", "dangerous\ndetected", "dangerous\nundetected", "coverage / %")
    shape = new_table("Failures in 1e9 h by part", "part", *heads)
    rows = list(table.by_part.items())
    for name, row in [*rows, ("unit", table.unit)]:
        rates = map(shown, (row.fit, *row.rates_fit().values()))
        coverage = percent(row.shares["detected"])
        shape.add_row(name, *rates, coverage, end_section=name == rows[-1][0])
    return shape
