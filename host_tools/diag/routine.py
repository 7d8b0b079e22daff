"""`rrins diag routine`: routines."""

from __future__ import annotations

from typing import Any

import click

from firmware_py.diagnostics import table
from firmware_py.diagnostics.codecs import Values
from firmware_py.diagnostics.routines import Routine, RoutineState
from host_tools.diag import show
from host_tools.diag.kinds import ROUTINE, STOPPABLE, complete_arguments
from host_tools.diag.options import json_option, with_securing_tester
from host_tools.diag.tester import Tester
from host_tools.diag.values import AssignmentError, assigned, limits_of, plain
from host_tools.errors import RoutineFailedError

_LOOK_S = 0.2


@click.group()
def routine() -> None:
    """Start and stop routines, and read their results."""


@routine.command("list")
@json_option
def list_routines(as_json: bool) -> None:
    """List the routines and their arguments. Needs no bus."""
    if as_json:
        show.as_json(
            [
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
        )
        return
    grid = show.grid(("number", "routine", "arguments", "what it does"))
    for one in table.ROUTINES:
        arguments = "\n".join(f"{field.name}: {limits_of(field)}" for field in one.arguments)
        grid.add_row(f"0x{one.number:04X}", one.name, arguments, one.text)
    show.put(grid)


def _show(one: Routine, results: Values, as_json: bool) -> None:
    if as_json:
        show.as_json({one.name: plain(one.result_layout, results)})
        return
    grid = show.grid(("routine", "result", "value", "unit"))
    name = one.name
    for field, value, unit in show.rows_of(one.results, results):
        grid.add_row(name, field, value, unit)
        name = ""
    show.put(grid)


@routine.command("start")
@click.argument("routine", type=ROUTINE)
@click.argument("texts", nargs=-1, metavar="[ARGUMENT=VALUE]...", shell_complete=complete_arguments)
@click.option("--wait", is_flag=True, help="Wait for its end; status 24 unless it is done.")
@click.option(
    "--limit",
    "limit_s",
    type=click.FloatRange(min=0, min_open=True),
    help="Longest wait, in seconds of the computer.",
)
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

    go_to_axis_angle and calibration last as long as the session, which ends 5 s after the command:
    use --wait, or the shell.
    """
    try:
        arguments = assigned(routine.arguments, texts)
    except AssignmentError as error:
        raise click.UsageError(f"{routine.name}: {error}") from error
    results = tester.start(routine, arguments)
    if wait:
        results = _awaited(tester, routine, results, limit_s)
    _show(routine, results, as_json)
    if wait and results["state"] != RoutineState.DONE:
        state = routine.result_layout.named(results)["state"]
        raise RoutineFailedError(f"routine {routine.name} is {state}")


def _awaited(tester: Tester, one: Routine, results: Values, limit_s: float | None) -> Values:
    waited_s = 0.0
    while results["state"] == RoutineState.RUNNING and (limit_s is None or waited_s < limit_s):
        tester.pass_time(_LOOK_S)
        waited_s += _LOOK_S
        results = tester.result(one)
    return results


def _simple(call: Any) -> Any:
    return json_option(with_securing_tester(call))


@routine.command("stop")
@click.argument("routine", type=STOPPABLE)
@_simple
def stop_routine(tester: Tester, routine: Routine, as_json: bool) -> None:
    """Stop a routine."""
    _show(routine, tester.stop(routine), as_json)


@routine.command("result")
@click.argument("routine", type=ROUTINE)
@_simple
def routine_result(tester: Tester, routine: Routine, as_json: bool) -> None:
    """Read a routine's results so far."""
    _show(routine, tester.result(routine), as_json)
