"""`rrins scenarios` and `rrins setup`: scenarios, and the set-up of their computer."""

from __future__ import annotations

import json

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import json_option, scenario_argument
from rrins.host_tools.cli.output import print_json, print_text
from rrins.host_tools.scenario.scenario import load, names, text_of


@click.group(cls=Group, invoke_without_command=True)
@click.pass_context
def scenarios(context: click.Context) -> None:
    """List the built-in scenarios, one per line."""
    if context.invoked_subcommand is None:
        for name in names():
            print_text(f"{name:<28} {load(name).title}", indent=29)


@scenarios.command("show")
@click.argument("name", shell_complete=complete_scenarios)
@json_option
def show_scenario(name: str, as_json: bool) -> None:
    """Print the TOML of a scenario, to copy and edit.

    With --json: every key with its value, defaults included, and the firmware's H, weights and
    calibration to the last digit.
    """
    if not as_json:
        click.echo(text_of(name), nl=False)
        return
    from rrins.host_tools.runs.set_up.fusion_set_up import fusion_set_up

    scenario = load(name)
    shown = {"scenario": scenario.model_dump(mode="json"), "fusion": fusion_set_up(scenario)}
    print_json(shown)


@scenarios.command("schema")
def show_schema() -> None:
    """Print the JSON schema of scenarios: keys, meanings, units, limits, defaults.

    Editors with a TOML language server complete and check the keys of a file that begins with
    the line `#:schema rrins.schema.json`, its path.
    """
    from rrins.host_tools.scenario.schema import json_schema

    click.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@click.command()
@scenario_argument
def setup(scenario: str) -> None:
    """Show the set-up of SCENARIO's navigation computer: a key and its values on each line.

    `rrins rehearse --firmware PROGRAM` gives it to PROGRAM as a file.
    """
    from rrins.host_tools.runs.set_up.setup_file import setup_text

    click.echo(setup_text(load(scenario)), nl=False)
