"""Writes the recording of a vehicle as the recording of a bus, with a note and the reference."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.dbc.codec import load
from rrins.dbc.contract import SENSOR_GROUPS, load_contract
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.bus.message import messages_of
from rrins.host_tools.files import write_whole
from rrins.host_tools.motion.table import ATTITUDE, PLACE, TIME, VELOCITY
from rrins.host_tools.recording.earlier import keep_earlier
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import READ, check_path, ending_of, open_writer
from rrins.host_tools.recording.note import Note, Part, write_note
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle import beginning, epochs, frames, set_up
from rrins.host_tools.vehicle.epochs import Epochs
from rrins.host_tools.vehicle.errors import VehicleError
from rrins.host_tools.vehicle.recording import Fixes, Reference, VehicleRecording

_PIECE = 2000  # epochs
_UNTOLD_VELOCITY_SIGMA = 10.0
"""m/s, of a velocity that the receiver does not tell: it weighs nothing."""

_MOST_FIXES_HZ = 25
_CHANNEL = "vehicle"
_MODE_COMMAND_S = 0.1


@dataclass(frozen=True)
class Imported:
    """Outcome of a recording.

    Attributes
    ----------
    frames, fixes : int
    """

    file: Path
    truth: Path | None
    scenario: Scenario
    frames: int
    fixes: int
    notes: tuple[str, ...]  #: for a person


def write(
    recording: VehicleRecording,
    path: Path,
    own_scenario: Path | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
    attitude: Floats | None = None,
    on_epochs: Callable[[int, int], None] = lambda done, total: None,
) -> Imported:
    """Write a recording of a vehicle as a log of the bus.

    Parameters
    ----------
    recording : VehicleRecording
    path : Path
        Of the log; its suffix selects the format.
    own_scenario : Path, optional
        TOML file whose keys go on top of what the recording says.
    start_s : float, optional
        When navigation begins, by the recording's clock.
    duration_s : float, optional
        Of the navigation; by default to the recording's end.
    attitude : array, shape (3,), optional
        Roll, pitch, heading where navigation begins, rad.
    on_epochs : callable
        Called with the epochs written, and with all.

    Raises
    ------
    VehicleError, RecordError, ScenarioError
    """
    check_path(path)
    if ending_of(path)[0] not in READ:
        raise RecordError(f"import {path}: must be of a format that can be read back")
    keys = set_up.own_keys(own_scenario)
    axes = set_up.axes_of(recording, keys)
    increments = recording.increments
    if max(increments.dtheta.shape[1], increments.dv.shape[1]) > SENSOR_GROUPS:
        raise VehicleError(f"import: more than {SENSOR_GROUPS} sensors of a kind")
    state = beginning.find(recording, axes, start_s, attitude)
    rate_hz = epochs.rate_of(increments)
    period_s = 1.0 / rate_hz
    begins_s = epochs.grid_begin(state.time_s, period_s, recording.fixes)
    ends_s = float(increments.time_s[-1])
    if recording.ends_s is not None:
        ends_s = min(ends_s, recording.ends_s)
    if duration_s is not None:
        ends_s = min(ends_s, begins_s + duration_s)
    contract = load_contract()
    sensor = contract[0]["sensor"][0]
    signals = (sensor["gyro_dtheta"], sensor["accelerometer_dv"])
    laid = epochs.laid_out(
        increments,
        begins_s,
        ends_s,
        rate_hz,
        (float(signals[0]["scale"]), float(signals[1]["scale"])),
        (int(signals[0]["raw_maximum"]), int(signals[1]["raw_maximum"])),
    )
    folder = Path() if own_scenario is None else own_scenario.parent
    duration = (len(laid) - 2) * period_s
    scenario = set_up.scenario_of(recording, state, rate_hz, duration, keys, folder)
    if scenario.rate_hz != rate_hz:
        raise VehicleError(f"import: rate_hz must be the recording's, {rate_hz}")
    track = _Track(laid, recording.fixes, scenario)
    kept = keep_earlier(path)
    count = _write_log(path, track, on_epochs)
    truth = _write_truth(path, recording.reference, track)
    write_note(
        path,
        Note(
            interface="vehicle",
            channel=recording.kind,
            time="simulated",
            frames=count,
            parts=(Part(file=path.name, first_s=0.0),),
            scenario_name=recording.name,
            scenario=scenario.model_dump(mode="json"),
            speed="max",
            origin="vehicle",
            truth=None if truth is None else truth.name,
        ),
    )
    notes = [*state.notes, *_notes_of(laid, recording)]
    if kept is not None:
        notes.append(f"the earlier {path.name} is now in {kept}")
    return Imported(path, truth, scenario, count, len(track.fixes), tuple(notes))


def _notes_of(laid: Epochs, recording: VehicleRecording) -> Iterator[str]:
    if laid.gaps:
        total = sum(length for _, length in laid.gaps)
        yield (
            f"{len(laid.gaps)} gaps in the increments, {rounded(total)} s in all, bridged at the "
            f"rate after each; the first at {laid.gaps[0][0]:.3f} s"
        )
    if laid.clipped:
        yield f"{laid.clipped} increments were beyond the range of a frame and are cut"
    if recording.fixes is None:
        yield "no GNSS: the navigation is not aided"
    elif recording.fixes.velocity_n is None:
        yield "the receiver tells no velocity: only its positions aid"


class _Track:
    """The frames of a recording, some epochs at a time.

    The lead-in, in which the firmware tests itself, repeats the first increments: they are not
    navigated.
    """

    def __init__(self, laid: Epochs, fixes: Fixes | None, scenario: Scenario) -> None:
        self.laid, self.scenario = laid, scenario
        self.lead = scenario.navigation_epoch + 1
        self.epochs = self.lead + len(laid)
        self.period_ns = scenario.period_ns
        # the clock of the bus: the end of epoch k is k T
        self.zero_s = laid.begins_s - scenario.navigation_epoch * laid.period_s
        self.fix_of = np.full(self.epochs, frames.NOTHING, dtype=np.int64)
        self.fixes = self._fixes(fixes)
        self.requests = self._requests()

    def _fixes(self, fixes: Fixes | None) -> Floats:
        """Return the rows of the fixes that are sent; note in which epoch each is."""
        if fixes is None:
            return np.zeros((0, 9))
        clock_s = fixes.time_s - self.zero_s
        epoch = np.ceil(clock_s / self.laid.period_s - 1e-3).astype(np.int64)
        usable = np.flatnonzero((epoch >= self.lead) & (epoch < self.epochs - 1))
        kept: list[int] = []
        last_s = -math.inf
        for k in usable.tolist():
            if clock_s[k] - last_s > 0.99 / _MOST_FIXES_HZ:
                kept.append(k)
                last_s = clock_s[k]
        velocity = beginning.velocities_of(fixes)
        sigma = np.full(len(clock_s), _UNTOLD_VELOCITY_SIGMA)
        if fixes.velocity_sigma is not None:
            sigma = np.minimum(_of_both(fixes.velocity_sigma), _UNTOLD_VELOCITY_SIGMA)
        longitude = np.degrees((fixes.place[:, 1] + np.pi) % (2 * np.pi) - np.pi)
        rows = np.column_stack(
            [
                np.rint(clock_s * 1e6),
                np.degrees(fixes.place[:, 0]),
                longitude,
                fixes.place[:, 2],
                velocity,
                np.minimum(_of_both(fixes.place_sigma), 40.0),
                sigma,
            ]
        )
        self.fix_of[epoch[kept]] = np.arange(len(kept))
        return np.ascontiguousarray(rows[kept])

    def _requests(self) -> Integers:
        """Return the operator's requests by epoch: value and counter."""
        value = load().value
        asked = round(self.scenario.navigate_at_s * self.scenario.rate_hz)
        request = np.zeros(self.epochs, dtype=np.int64)
        request[asked:] = value("MODE_COMMAND", "mode_request", "NAVIGATE_STRAPDOWN")
        request[-1] = value("MODE_COMMAND", "mode_request", "SHUTDOWN")
        every = max(1, round(_MODE_COMMAND_S * self.scenario.rate_hz))
        sent = np.arange(self.epochs) % every == 0
        sent[[asked, -1]] = True
        found = np.full((self.epochs, 2), frames.NOTHING, dtype=np.int64)
        found[sent, 0] = request[sent]
        found[sent, 1] = np.arange(int(sent.sum()))
        return found

    def pieces(self) -> Iterator[tuple[FrameArray, Integers]]:
        """Yield frames and the epoch of each."""
        contract = load_contract()
        outbox = frame_array(_PIECE * frames.MOST_FRAMES)
        epoch_of = np.zeros(len(outbox), dtype=np.int64)
        for first in range(0, self.epochs, _PIECE):
            last = min(self.epochs, first + _PIECE)
            rows = np.arange(first, last) - self.lead
            rows[rows < 0] %= min(self.lead, len(self.laid))
            count = frames.write_epochs(
                contract,
                first,
                self.period_ns,
                self.laid.gyros[rows],
                self.laid.accelerometers[rows],
                self.requests[first:last],
                self.fix_of[first:last],
                self.fixes,
                outbox,
                epoch_of,
            )
            yield outbox[:count], epoch_of[:count]


def _of_both(sigma: Floats) -> Floats:
    """Return one standard deviation for all components: level ones, unless up is far worse."""
    level = np.sqrt(np.mean(np.square(sigma[:, :2]), axis=1))
    return np.maximum(level, sigma[:, 2] / 2)


def _write_log(path: Path, track: _Track, on_epochs: Callable[[int, int], None]) -> int:
    writer = open_writer(path)
    count = 0
    try:
        for piece, epoch_of in track.pieces():
            bounds = np.flatnonzero(np.diff(epoch_of, prepend=-1, append=-1))
            for begin, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
                time_s = int(epoch_of[begin]) * track.period_ns / 1e9
                for message in messages_of(piece[begin:end], time_s, _CHANNEL):
                    writer.on_message_received(message)
            count += len(piece)
            on_epochs(int(epoch_of[-1]) + 1, track.epochs)
    except OSError as error:
        raise RecordError(f"import {path}: cannot be written: {error.strerror or error}") from error
    finally:
        writer.stop()
    return count


def _write_truth(path: Path, reference: Reference | None, track: _Track) -> Path | None:
    """Write the reference beside a log, by the clock of the bus; return its path."""
    if reference is None:
        return None
    clock_s = reference.time_s - track.zero_s
    end_s = track.epochs * track.laid.period_s
    rows = np.flatnonzero((clock_s > -2.0) & (clock_s < end_s + 2.0))
    if len(rows) < 2:
        raise VehicleError("import: the truth has another time than the increments")
    columns = [clock_s, *np.degrees(reference.place[:, :2]).T, reference.place[:, 2]]
    names = [TIME, *PLACE]
    if reference.velocity_n is not None:
        columns += list(reference.velocity_n.T)
        names += VELOCITY
    if reference.attitude is not None:
        columns += list(np.degrees(reference.attitude).T)
        names += ATTITUDE
    texts = [[repr(value) for value in column[rows].tolist()] for column in columns]
    truth = path.with_name(path.name + ".truth.csv")

    def write_rows(file: IO[str]) -> None:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*texts, strict=True))

    write_whole(truth, write_rows)
    return truth
