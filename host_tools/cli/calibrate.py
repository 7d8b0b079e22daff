"""`rrins calibrate`: calibrate a unit on its own table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.options import bus_options, json_option
from rrins.host_tools.errors import CalibrationRecordError, RehearsalError

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.firmware_py.core.settings import Scheme
    from rrins.host_tools.calibration.estimation import Estimate, Unit
    from rrins.host_tools.calibration.seconds import Seconds
    from rrins.host_tools.calibration.session import Recording
    from rrins.host_tools.diag.tester import Tester
    from rrins.host_tools.rotation.inputs import NamedScheme
    from rrins.host_tools.scenario.scenario import Scenario


@click.command()
@click.argument("scenario", required=False)
@bus_options
@click.option("--rimu", "geometry", metavar="GEOMETRY", help="Sensor axes, without a scenario.")
@click.option(
    "--scheme", "scheme_name", default="calibration", show_default=True, help="Name or TOML file."
)
@click.option("--rate", "turn_rate_dps", type=float, help="Turn rate, °/s.")
@click.option("--stand", "stand_s", type=float, help="Rest after each turn, s.")
@click.option("--seed", type=click.IntRange(0), default=1, help="Of the errors that are drawn.")
@click.option("--push", "pushes", is_flag=True, help="Store it in the unit; verify it there.")
@click.option("--anew", is_flag=True, help="Do not go on from where a calibration stopped.")
@json_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/calibrate"),
    show_default=True,
    help="Folder for the calibration file and the report.",
)
def calibrate(
    scenario: str | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    geometry: str | None,
    scheme_name: str,
    turn_rate_dps: float | None,
    stand_s: float | None,
    seed: int,
    pushes: bool,
    anew: bool,
    as_json: bool,
    out: Path,
) -> None:
    """Calibrate the sensors of a unit on its own table: all constants, with their uncertainty.

    With --channel, the unit on that bus, whose sensors are those of SCENARIO or --rimu; it must
    stand still. Else an emulated unit at full speed: that of SCENARIO, or one with the prototype's
    noise and drawn errors. Ctrl-C leaves the unit in STANDBY with its old calibration; the same
    command goes on from there.
    """
    from rrins.host_tools.calibration.emulated import EmulatedUnit
    from rrins.host_tools.calibration.routine import told_unit
    from rrins.host_tools.calibration.unit import drawn_unit
    from rrins.host_tools.diag.target import Target
    from rrins.host_tools.diag.tester import Tester
    from rrins.host_tools.rotation.inputs import rimu_table, scheme_of
    from rrins.host_tools.scenario.scenario import load

    named = scheme_of(scheme_name, turn_rate_dps, stand_s)
    table = rimu_table(geometry or "tetrahedron")
    known: Scenario = load(scenario) if scenario else drawn_unit(seed, table)
    attached = channel is not None or interface != "rrins"
    name = f"{interface} {channel}" if attached else (scenario or f"{known.title}, seed {seed}")
    _make(out)
    target = Target(interface, channel, bitrate) if attached else EmulatedUnit(known).target()
    with Tester(target, is_securing=True) as tester:
        unit = told_unit(tester, (known.rimu.gyros, known.rimu.accelerometers))
        work = _Work(tester, unit, named, out, name)
        found = work.record(anew)
        verified = work.push(found) if pushes else ""
    paths = work.write(found, verified)
    truth = known if scenario is None and not attached else None
    _print(found, truth, verified, [str(path) for path in paths], as_json)


class _Work:
    """The steps of a calibration, with progress on standard error."""

    def __init__(
        self, tester: Tester, unit: Unit, named: NamedScheme, out: Path, name: str
    ) -> None:
        self._tester, self._unit, self._named = tester, unit, named
        self._out, self._name = out, name

    def record(self, anew: bool) -> Estimate:
        from rrins.host_tools.calibration.session import RECORD, Recording, checked
        from rrins.host_tools.cli.output import print_note

        path = self._out / RECORD
        if anew:
            path.unlink(missing_ok=True)
        recording = Recording.resumed(self._named.scheme, path)
        if recording.first:
            print_note(f"going on with position {recording.first + 1}; --anew begins anew")
        seconds = self._follow("calibrating", recording)
        recording.discard()
        return checked(self._unit, seconds)

    def _follow(self, what: str, recording: Recording) -> Seconds:
        from rrins.host_tools.interruption import as_event
        from rrins.host_tools.terminal import new_console, progress_line

        positions = len(recording.scheme.turns)
        with progress_line(new_console(stderr=True)) as progress, as_event() as stop:
            task = progress.add_task(what, total=_expected_s(recording.scheme))

            def advance(seconds: float, position: int) -> None:
                state = (f"position {position + 1} of {positions}",)
                progress.update(task, completed=seconds, state=state)

            return recording.run(self._tester, advance, stop.is_set)

    def push(self, found: Estimate) -> str:
        """Store, restart, calibrate once more in short; put the former back if they disagree."""
        from rrins.host_tools.calibration import session

        former = session.push(self._tester, found)
        try:
            scheme = session.verification(self._named.scheme)
            seconds = self._follow("verifying", session.Recording(scheme))
            second = session.checked(self._unit, seconds)
            rms, most = session.disagreement(found, second)
            if not session.agrees(rms, most):
                raise CalibrationRecordError(
                    f"calibration: a second run differs by {rms:.1f} σ rms, {most:.1f} σ at most; "
                    "the unit has its old calibration again"
                )
        except BaseException:
            session.restore(self._tester, former)
            raise
        return (
            f"stored in the unit; a second run of {second.seconds.total_s:.0f} s differs by "
            f"{rms:.2f} σ rms, {most:.1f} σ at most"
        )

    def write(self, found: Estimate, verified: str) -> list[Path]:
        from rrins.host_tools.calibration.report import write
        from rrins.host_tools.calibration.session import origin_of

        origin = origin_of(self._name, self._named.name, self._named.scheme, found)
        return write(self._out, self._unit, found, self._name, origin, verified)


def _expected_s(scheme: Scheme) -> float:
    """Return about how much will be recorded."""
    turning = sum(turn.angle_deg != 0 for turn in scheme.turns)
    return scheme.cycle_s + 0.7 * turning


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be created: {error.strerror}") from error


def _print(
    found: Estimate, truth: Scenario | None, verified: str, paths: list[str], as_json: bool
) -> None:
    from rrins.host_tools.calibration.monte_carlo import errors_of
    from rrins.host_tools.calibration.report import result_of
    from rrins.host_tools.terminal import new_console, print_table

    errors = None if truth is None else [one.rms.tolist() for one in errors_of(truth, found)]
    if as_json:
        result = result_of(found) | {"files": paths, "verified": verified}
        if errors is not None:
            result["rms_errors"] = dict(zip(("gyros", "accelerometers"), errors, strict=True))
        click.echo(json.dumps(result))
        return
    console = new_console()
    print_table(_table(found, errors), console)
    lines = [verified] if verified else []
    for line in (*lines, *paths):
        console.print(line, highlight=False, soft_wrap=True)


def _table(found: Estimate, errors: list[list[float]] | None) -> Table:
    from rich.table import Table

    from rrins.host_tools.calibration.report import kinds_of

    title = f"{found.seconds.total_s:.0f} s on the table"
    table = Table(title=title, title_justify="left")
    table.add_column("constant")
    count = max(len(found.gyros.constants), len(found.accelerometers.constants))
    for k in range(count):
        table.add_column(str(k + 1), justify="right")
    heads = ("σ, rms", "wanted", *(("true error, rms",) if errors else ()))
    for head in heads:
        table.add_column(head, justify="right")
    for number, kind in enumerate(kinds_of(found)):
        for k, row in enumerate(kind["rows"]):
            cells = [value for value, _ in row["cells"]]
            cells += [""] * (count - len(cells))
            more = [f"{errors[number][k]:.2g}"] if errors else []
            what = f"{kind['name'].removesuffix('s')} {row['name']} / {row['unit']}"
            table.add_row(what, *cells, row["sigma"], row["wanted"], *more)
        for word in ("before", "after"):
            cells = [*kind[word], *[""] * (count - kind["count"] + len(heads))]
            what = f"residual {word}, rms / {kind['unit']}"
            table.add_row(what, *cells, end_section=word == "after")
    return table
