"""A calibration from start to end: recorded, kept, estimated, checked; pushed and verified."""

from __future__ import annotations

import datetime
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rrins.firmware_py.core.sensors.calibration import Origin
from rrins.firmware_py.core.settings import Scheme
from rrins.firmware_py.diagnostics import calibration_image
from rrins.firmware_py.diagnostics.calibration_record import CalibrationEnd
from rrins.host_tools.calibration import seconds as records
from rrins.host_tools.calibration.checks import trouble_of
from rrins.host_tools.calibration.estimation import Estimate, Unit, estimate
from rrins.host_tools.calibration.file import UNKNOWN, to_toml
from rrins.host_tools.calibration.routine import RoutineRun
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.diag import calibration_file
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import CalibrationRecordError
from rrins.host_tools.files import JsonObject

RECORD = "record.json"
"""Record in the output folder, there until the calibration is done."""

_KEEP_EVERY_S = 60.0
_HARD = 1
_SETTLE_S = 3.0
_AGREE_RMS, _AGREE_MOST = 1.6, 6.0
"""Of the differences of two calibrations over their σ."""

_TRIES = 3
"""At one position, before a unit that does not hear this tool in time is given up."""

OnProgress = Callable[[float, int], None]
"""Called with the seconds recorded and the position, from 0."""


@dataclass
class Recording:
    """The seconds of a scheme, as far as they have been recorded.

    Parameters
    ----------
    path : Path, optional
        Where they are kept, to go on from.
    seconds : Seconds, optional
        Of former positions.
    first : int
        The position to go on with.
    """

    scheme: Scheme
    path: Path | None = None
    seconds: Seconds | None = None
    first: int = 0

    @classmethod
    def resumed(cls, scheme: Scheme, path: Path) -> Recording:
        """Return the recording that was begun at a path with the same scheme; else a new one.

        Raises
        ------
        CalibrationRecordError
            When what is there is no record.
        """
        if not path.exists():
            return cls(scheme, path)
        found, note = records.load(path)
        if note.get("scheme") != scheme.model_dump(mode="json") or not len(found):
            return cls(scheme, path)
        recording = cls(scheme, path, found)
        recording.go_back()
        return recording

    def go_back(self) -> None:
        """Forget the position that was under way: it comes next."""
        if self.seconds is not None and len(self.seconds):
            self.first = int(self.seconds.position[-1])
            self.seconds = self.seconds.where(self.seconds.position < self.first)

    def add(self, more: Seconds) -> None:
        """Add new seconds."""
        self.seconds = more if self.seconds is None else self.seconds + more

    def keep(self) -> None:
        """Write what there is."""
        if self.path is not None and self.seconds is not None:
            note: JsonObject = {"scheme": self.scheme.model_dump(mode="json")}
            records.save(self.path, self.seconds, note)

    def discard(self) -> None:
        """Remove the file: the calibration is done."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def run(
        self,
        tester: Tester,
        on_progress: OnProgress,
        should_stop: Callable[[], bool] = lambda: False,
        on_silence: Callable[[int], None] = lambda position: None,
    ) -> Seconds:
        """Record on a unit until the scheme is over.

        A unit that hears nothing of this tool for 5 s, because the host or the bus stood still,
        ends its routine. `on_silence` is then called with a position, from 0, and recording goes on
        with that.

        Raises
        ------
        CalibrationRecordError
            When the unit ends early; what was recorded is kept.
        KeyboardInterrupt
            When `should_stop` says so; what was recorded is kept, and the unit is in STANDBY.
        """
        tries = Counter[int]()
        while True:
            routine = RoutineRun(tester, self.scheme, self.first)
            end = self._follow(routine, on_progress, should_stop)
            if end == CalibrationEnd.STOPPED and should_stop():
                raise KeyboardInterrupt
            if end != CalibrationEnd.SESSION_ENDED:
                break
            self.go_back()
            tries[self.first] += 1
            if tries[self.first] == _TRIES:
                break
            on_silence(self.first)
        if end not in (CalibrationEnd.DONE, CalibrationEnd.STOPPED, CalibrationEnd.SESSION_ENDED):
            self.discard()  # the unit found something wrong with what it recorded
        routine.require_done(end)
        assert self.seconds is not None
        return self.seconds

    def _follow(
        self, routine: RoutineRun, on_progress: OnProgress, should_stop: Callable[[], bool]
    ) -> CalibrationEnd:
        """Add what a routine records until it ends, and keep it; return why it ended."""
        kept_s = 0.0

        def take(more: Seconds) -> None:
            nonlocal kept_s
            self.add(more)
            assert self.seconds is not None
            total_s = self.seconds.total_s
            on_progress(total_s, int(more.position[-1]))
            if total_s - kept_s > _KEEP_EVERY_S:
                self.keep()
                kept_s = total_s

        routine.start()
        try:
            return routine.follow(take, should_stop)
        finally:
            self.keep()


def checked(unit: Unit, seconds: Seconds) -> Estimate:
    """Return the estimate of a record that is sound.

    Raises
    ------
    CalibrationRecordError
        When the record does not suffice, or something moved or changed meanwhile.
    """
    found = estimate(unit, seconds)
    trouble = trouble_of(unit, found)
    if trouble:
        raise CalibrationRecordError(f"calibration: {trouble}; nothing is stored")
    return found


def origin_now(temperature_c: float | None = None) -> Origin:
    """Return the origin of a calibration that ends now."""
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    return Origin(date_utc=now, temperature_c=temperature_c)


def how_of(
    unit_name: str, scheme_name: str, scheme: Scheme, found: Estimate, origin: Origin
) -> list[str]:
    """Return how a calibration was obtained, in lines."""
    when = "" if origin.date_utc is None else f", {origin.date_utc:%Y-%m-%d %H:%M} UTC"
    warm = "" if origin.temperature_c is None else f", sensors at {origin.temperature_c:g} °C"
    return [
        f"rrins calibrate{when}{warm}: {unit_name}",
        f"least squares over {found.seconds.total_s:.0f} s on the table, scheme {scheme_name} at "
        f"{scheme.turn_rate_dps:g} °/s, {scheme.stand_s:g} s at rest after each turn",
    ]


def push(tester: Tester, found: Estimate, origin: Origin = UNKNOWN) -> bytes:
    """Write the constants into the parameter memory, and restart; return the former file.

    With them goes how well they are known, when they were found, and how warm the sensors were.
    """
    former = tester.pull()
    current = calibration_image.decode(former)
    wanted = calibration_file.from_toml(to_toml(found, (), origin), current)
    # Positions of the accelerometers are not estimated: they stay as they are.
    for number, values in wanted.items():
        for name in values:
            if name.startswith("position_"):
                values[name] = current[number][name]
    tester.push(calibration_image.encode(wanted))
    _restart(tester)
    stored = calibration_image.decode(tester.pull())
    if any(stored[number] != values for number, values in wanted.items()):
        restore(tester, former)
        raise CalibrationRecordError("calibration: what is read back differs from what was written")
    return former


def restore(tester: Tester, former: bytes) -> None:
    """Put a former calibration back."""
    tester.push(former)
    _restart(tester)


def _restart(tester: Tester) -> None:
    tester.reset(_HARD)
    tester.conversation.pass_time(_SETTLE_S)


def verification(scheme: Scheme) -> Scheme:
    """Return a shorter run through the same attitudes: faster, with short rests."""
    turns = tuple(turn for turn in scheme.turns if turn.angle_deg)
    rate_dps = min(60.0, max(10.0, scheme.turn_rate_dps))
    return Scheme(turns=turns, turn_rate_dps=rate_dps, stand_s=min(scheme.stand_s, 3.0))


def disagreement(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Return the rms and the largest difference of two calibrations' constants over their σ."""
    ratios = []
    for kind in ("gyros", "accelerometers"):
        one, other = getattr(first, kind), getattr(second, kind)
        sigma = np.hypot(one.sigma, other.sigma)
        ratios.append(((one.constants - other.constants) / sigma).ravel())
    together = np.concatenate(ratios)
    return float(np.sqrt((together**2).mean())), float(np.abs(together).max())


def agrees(rms: float, most: float) -> bool:
    """Return whether two calibrations agree, as `disagreement` compares them."""
    return rms < _AGREE_RMS and most < _AGREE_MOST
