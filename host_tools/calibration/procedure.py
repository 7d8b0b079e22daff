"""The whole calibration of a unit: recorded on its table, estimated, pushed, verified, written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rrins.firmware_py.core.sensors.calibration import Origin
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration import session
from rrins.host_tools.calibration.emulated import EmulatedUnit
from rrins.host_tools.calibration.estimation import Estimate, Unit
from rrins.host_tools.calibration.monte_carlo import errors_of
from rrins.host_tools.calibration.report import write
from rrins.host_tools.calibration.routine import told_unit
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.unit import drawn_unit
from rrins.host_tools.diag.target import DEFAULT_TIMEOUT_S, Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import CalibrationRecordError
from rrins.host_tools.files import make_folder
from rrins.host_tools.interruption import as_event
from rrins.host_tools.rotation.inputs import NamedScheme, rimu_table, scheme_of
from rrins.host_tools.runs.set_up.data_sheets import data_sheets_of
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.host_tools.terminal import new_console, progress_line


@dataclass(frozen=True)
class Order:
    """A calibration to run.

    Attributes
    ----------
    turn_rate_dps, stand_s : float, optional
        In place of the scheme's own.
    """

    folder: Path  #: for the calibration file and the report
    #: whose unit; without it an emulated one with the prototype's noise and drawn errors
    scenario: str | None = None
    interface: str = "rrins"
    channel: str | None = None
    bitrate: int | None = None  #: bus of a unit that is there; without a channel one is emulated
    geometry: str | None = None  #: of the sensors, without a scenario
    scheme: str = "calibration"  #: built in, or a TOML file
    turn_rate_dps: float | None = None
    stand_s: float | None = None
    seed: int = 1  #: of the errors that are drawn
    pushes: bool = False  #: whether to store the calibration in the unit, and to verify it there
    anew: bool = False  #: whether to begin anew where a calibration was stopped
    #: how warm the sensors are, °C, where somebody knows: the bus does not say
    temperature_c: float | None = None
    #: longest wait for a response of a unit that is there, in place of `DEFAULT_TIMEOUT_S`
    timeout_s: float | None = None

    @property
    def is_attached(self) -> bool:
        """Whether the unit is one that is there."""
        return self.channel is not None or self.interface != "rrins"


@dataclass(frozen=True)
class Calibrated:
    """Results of a calibration."""

    estimate: Estimate
    verified: str  #: what the second run said, where it was pushed
    files: list[Path]
    #: of gyros and accelerometers, the rms of each constant's true error, where it is known
    errors: list[list[float]] | None


def calibrate(order: Order, note: Callable[[str], None] = lambda line: None) -> Calibrated:
    """Calibrate a unit; progress goes to standard error.

    Parameters
    ----------
    note : callable
        Called with a line that a person should read.

    Raises
    ------
    RehearsalError
        One line: what went wrong. The unit then has its old calibration.
    KeyboardInterrupt
        Stopped; the next one goes on from there.
    """
    named = scheme_of(order.scheme, order.turn_rate_dps, order.stand_s)
    table = rimu_table(order.geometry or "tetrahedron")
    known = load(order.scenario) if order.scenario else drawn_unit(order.seed, table)
    make_folder(order.folder)
    with Tester(_target(order, known), is_securing=True) as tester:
        unit = told_unit(tester, (known.rimu.gyros, known.rimu.accelerometers))
        if order.scenario or not order.is_attached:
            unit = replace(unit, sheets=data_sheets_of(known))
        work = _Work(tester, unit, named, order.folder, note)
        found = work.record(order.anew)
        origin = session.origin_now(order.temperature_c)
        verified = work.push(found, origin) if order.pushes else ""
    name = _name(order, known)
    how = session.how_of(name, named.name, named.scheme, found, origin)
    files = write(order.folder, unit, found, name, how, verified, origin)
    is_drawn = order.scenario is None and not order.is_attached
    errors = [one.rms.tolist() for one in errors_of(known, found)] if is_drawn else None
    return Calibrated(found, verified, files, errors)


def _target(order: Order, known: Scenario) -> Target:
    if order.is_attached:
        timeout_s = order.timeout_s or DEFAULT_TIMEOUT_S
        return Target(order.interface, order.channel, order.bitrate, timeout_s=timeout_s)
    return EmulatedUnit(known).target()


def _name(order: Order, known: Scenario) -> str:
    if order.is_attached:
        return f"{order.interface} {order.channel}"
    return order.scenario or f"{known.title}, seed {order.seed}"


class _Work:
    """The steps of a calibration, with progress on standard error."""

    def __init__(
        self,
        tester: Tester,
        unit: Unit,
        named: NamedScheme,
        folder: Path,
        note: Callable[[str], None],
    ) -> None:
        self._tester, self._unit, self._named, self._folder = tester, unit, named, folder
        self._note = note

    def record(self, anew: bool) -> Estimate:
        path = self._folder / session.RECORD
        if anew:
            path.unlink(missing_ok=True)
        recording = session.Recording.resumed(self._named.scheme, path)
        if recording.first:
            self._note(f"going on with position {recording.first + 1}; --anew begins anew")
        seconds = self._follow("calibrating", recording)
        recording.discard()
        return session.checked(self._unit, seconds)

    def _follow(self, what: str, recording: session.Recording) -> Seconds:
        positions = len(recording.scheme.turns)
        with progress_line(new_console(stderr=True)) as progress, as_event() as stop:
            task = progress.add_task(what, total=_expected_s(recording.scheme))

            def advance(seconds: float, position: int) -> None:
                state = (f"position {position + 1} of {positions}",)
                progress.update(task, completed=seconds, state=state)

            return recording.run(self._tester, advance, stop.is_set, self._silent)

    def _silent(self, position: int) -> None:
        self._note(
            f"the unit heard nothing of this tool for 5 s; going on with position {position + 1}"
        )

    def push(self, found: Estimate, origin: Origin) -> str:
        """Store, restart, calibrate once more in short; put the former back if they disagree."""
        former = session.push(self._tester, found, origin)
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


def _expected_s(scheme: Scheme) -> float:
    """Return about how much will be recorded."""
    turning = sum(turn.angle_deg != 0 for turn in scheme.turns)
    return scheme.cycle_s + 0.7 * turning
