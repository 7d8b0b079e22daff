"""`rrins diag routine`: start, stop and query routines."""

from __future__ import annotations

import click

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.routines import Routine, RoutineState
from rrins.host_tools.cli.diag.arguments import ROUTINE, STOPPABLE, complete_arguments
from rrins.host_tools.cli.diag.options import with_securing_tester
from rrins.host_tools.cli.diag.output import grid, value_grid
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import POSITIVE, flag, json_option, option
from rrins.host_tools.cli.output import print_results
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.diag.values import AssignmentError, limits_of, parse_values, to_json
from rrins.host_tools.errors import RoutineFailedError

_LOOK_S = 0.2


@click.group(cls=Group)
def routine() -> None:
    """Start and stop routines, read their results."""


@routine.command("list")
@json_option
def list_routines(as_json: bool) -> None:
    """List the routines and their arguments. Needs no bus."""
    values = [
        {
            "number": f"0x{one.number:04X}",
            "name": one.name,
            "text": one.text,
            "access": str(one.access),
            "can_stop": one.can_stop,
            "arguments": {field.name: limits_of(field) for field in one.arguments},
            "results": [field.name for field in one.results],
        }
        for one in table.ROUTINES
    ]
    rows = grid("number", "routine", "arguments", "description")
    for one in table.ROUTINES:
        arguments = "\n".join(f"{field.name}: {limits_of(field)}" for field in one.arguments)
        rows.add_row(f"0x{one.number:04X}", one.name, arguments, one.text)
    print_results(as_json, values, [rows])


def _print_results(one: Routine, results: Values, as_json: bool) -> None:
    values = {one.name: to_json(one.result_layout, results)}
    shown = value_grid(("routine", "result"), [(one.name, one.results, results)])
    print_results(as_json, values, [shown])


@routine.command("start")
@click.argument("routine", type=ROUTINE)
@click.argument("texts", nargs=-1, metavar="[ARGUMENT=VALUE]...", shell_complete=complete_arguments)
@flag("--wait", "Wait until it ends; exit with status 24 unless it is done.")
@option("--limit limit_s", "Longest wait, in seconds of the computer's time.", POSITIVE)
@json_option
@with_securing_tester
def start_routine(
    tester: Tester,
    routine: Routine,
    texts: tuple[str, ...],
    wait: bool,
    limit_s: float | None,
    as_json: bool,
) -> None:
    """Start a routine.

    go_to_axis_angle and calibration stop when the session ends, 5 s after the command: use --wait
    or the shell.
    """
    try:
        arguments = parse_values(routine.arguments, texts)
    except AssignmentError as error:
        raise click.UsageError(f"{routine.name}: {error}") from error
    results = tester.start(routine, arguments)
    if wait:
        results = _wait_for_end(tester, routine, results, limit_s)
    _print_results(routine, results, as_json)
    if wait and results["state"] != RoutineState.DONE:
        state = routine.result_layout.named(results)["state"]
        raise RoutineFailedError(f"routine {routine.name} is {state}")


def _wait_for_end(tester: Tester, one: Routine, results: Values, limit_s: float | None) -> Values:
    waited_s = 0.0
    while results["state"] == RoutineState.RUNNING and (limit_s is None or waited_s < limit_s):
        tester.conversation.pass_time(_LOOK_S)
        waited_s += _LOOK_S
        results = tester.result(one)
    return results


@routine.command("stop")
@click.argument("routine", type=STOPPABLE)
@json_option
@with_securing_tester
def stop_routine(tester: Tester, routine: Routine, as_json: bool) -> None:
    """Stop a routine."""
    _print_results(routine, tester.stop(routine), as_json)


@routine.command("result")
@click.argument("routine", type=ROUTINE)
@json_option
@with_securing_tester
def routine_result(tester: Tester, routine: Routine, as_json: bool) -> None:
    """Read the results of a routine so far."""
    _print_results(routine, tester.result(routine), as_json)
