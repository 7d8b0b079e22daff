"""The loop that runs share: one of them leads, the others follow it eight at a time.

The leading run goes through both steps as ever. What it shares with the others - the vehicle's
motion, the table, the commands of the scheme - is written down for each epoch; of a run that
follows, only sensors, comparison and navigation are left. Once a second its sensors are compared
by the firmware's own code; a run of which that says more than "nothing" is lost here, for it has to
go through all of its steps.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.lanes import LANES
from rrins.compiled.record import Bytes, Floats, Integers, Records
from rrins.dbc.contract import Contract
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.navigation.strapdown import parallel
from rrins.firmware_py.core.records.memory import Ins, Ram
from rrins.firmware_py.core.records.redundancy_records import ACCELEROMETERS, OUTER_TURN
from rrins.firmware_py.core.redundancy import drift as calibration_drift
from rrins.firmware_py.core.redundancy import standing, watch
from rrins.firmware_py.core.step import output
from rrins.host_tools.hardware import sensors
from rrins.host_tools.hardware.memory import INNER, OUTER, Plant, Sensors, Truth
from rrins.host_tools.hardware.noise import normals
from rrins.host_tools.hardware.step import drift, note_truth
from rrins.host_tools.runs.fast import step_both
from rrins.host_tools.runs.together import memory as lanes
from rrins.host_tools.runs.together import rows
from rrins.host_tools.runs.together.epoch import run_epoch

AHEAD = 2048
"""Most epochs that the leading run is ahead: the memory of eight runs, which is large, then stays
near the processor for as long."""

SPAN = 256
"""Most epochs for which noise is drawn at once."""

_NEAR = 0.04
"""rad, by which latitudes may differ."""


@compiled
def _lead(
    plant: Plant,
    pieces: Floats,
    state: Ram,
    contract: Contract,
    felt: Records[Sensors],
    shared: Floats,
    compares: bool | None,
) -> None:
    """Run an epoch of the leading run; write down what all runs share."""
    ins, redundancy, dt = state.ins, state.redundancy, plant.period_ns * 1e-9
    turn = shared[rows.TABLE_TURN : rows.TABLE_TURN + 3]
    latitude = parallel(ins)
    shared[rows.REFERENCE] = latitude.value
    shared[rows.SINE], shared[rows.COSINE] = latitude.sine, latitude.cosine
    earth.turn(turn, ins.C_s_n, latitude, dt)
    step_both(plant, pieces, state, contract, compares, None)
    sensors.feel(felt[0], plant.dtheta_s, shared[rows.TRUE_DTHETA : rows.TRUE_DTHETA + 3])
    sensors.feel(felt[1], plant.dv_s, shared[rows.TRUE_DV : rows.TRUE_DV + 3])
    for i in range(3):
        shared[rows.FORCE + i] = plant.dv_s[i]
        turn[i] = redundancy.expected_dtheta_s[i] - turn[i]
        for j in range(3):
            shared[rows.C_S_B + 3 * i + j] = state.C_s_b[i, j]
    shared[rows.OUTER_TURN] = redundancy.outer_turn
    shared[rows.RATES] = state.assembly.encoder_rate_dps[INNER]
    shared[rows.RATES + 1] = state.assembly.encoder_rate_dps[OUTER]


@compiled
def is_sound(state: Ram, compares: bool | None) -> bool:
    """Return whether a run navigates, and nothing has happened to its sensors."""
    if not modes.navigating(state):
        return False
    if compares is None:
        return True
    redundancy = state.redundancy
    happened = redundancy.gyros.alarm_epoch + redundancy.accelerometers.alarm_epoch
    excluded = redundancy.gyros.excluded | redundancy.accelerometers.excluded
    return bool(redundancy.expected_known and happened == 0 and excluded == 0)


@compiled
def is_sound_array(ram: Records[Ram], compares: bool | None) -> bool:
    """Return `is_sound` of a run, for a caller in Python."""
    return is_sound(ram[0], compares)


@compiled
def _draw(
    plant: Plant, noise: Floats, lane: int, epochs: int, work: Floats, bits: Integers
) -> None:
    """Draw the white noise of a run's sensors for some epochs, into its lane."""
    first = 0
    for kind in range(2):
        source = plant.gyros
        if kind == ACCELEROMETERS:
            source, first = plant.accelerometers, int(plant.gyros.count)
        for k in range(source.count):
            if source.noise_increment[k] > 0.0:
                normals(source, k, noise[:epochs, first + k, lane], work, bits)


@compiled
def _prepare(
    plants: Records[Plant],
    first: int,
    last: int,
    memory: Floats,
    noise: Floats,
    epoch: int,
    epochs: int,
    lost: Bytes,
    work: Floats,
    bits: Integers,
) -> None:
    """Let the errors of some runs drift if they are due, and draw the noise of some epochs."""
    for run in range(first, last):
        if lost[run]:
            continue
        own = plants[run]
        own.epoch = epoch
        if epoch % own.drift_epochs == 0:
            drift(own, own.period_ns * 1e-9)
            lanes.take_drift(memory, run - first, own)
        _draw(own, noise, run - first, epochs, work, bits)


@compiled
def _is_clear(plant: Plant, state: Ram, contract: Contract, memory: Floats, lane: int) -> bool:
    """Return whether nothing has happened to a run's sensors in the present second."""
    layout = contract.sensor[0]
    for kind in range(2):
        measures, repetition = plant.gyros, state.diagnostics.gyro_repetition
        unit, largest = layout.gyro_dtheta.scale, layout.gyro_dtheta.raw_maximum
        if kind == ACCELEROMETERS:
            measures = plant.accelerometers
            repetition = state.diagnostics.accelerometer_repetition
            unit = layout.accelerometer_dv.scale
            largest = layout.accelerometer_dv.raw_maximum
        if not lanes.is_clear(memory, lane, kind, measures, repetition, unit, largest):
            return False
    return True


@compiled
def _close_second(
    plant: Plant,
    state: Ram,
    contract: Contract,
    memory: Floats,
    lane: int,
    epochs: int,
    phases: Integers,
    shared: Floats,
    sums: Floats,
    compares: bool | None,
) -> bool:
    """End a second of a run; return whether it is still sound.

    `sums` of the epochs' outer turn, and of its amount.
    """
    if not _is_clear(plant, state, contract, memory, lane):
        return False
    off = memory[rows.LATITUDE, lane] + memory[rows.DLATITUDE, lane] - shared[rows.REFERENCE]
    if not abs(off) < _NEAR or not modes.plausible(state.ins):
        return False
    if compares is None:
        return True
    redundancy, ins = state.redundancy, state.ins
    state.assembly.encoder_rate_dps[INNER] = shared[rows.RATES]
    state.assembly.encoder_rate_dps[OUTER] = shared[rows.RATES + 1]
    east, north = ins.velocity_n[0], ins.velocity_n[1]
    ins.velocity_n[0] = memory[rows.BEFORE, lane]  # the comparison comes before the navigation
    ins.velocity_n[1] = memory[rows.BEFORE + 1, lane]
    redundancy.epochs = 0
    standing.note_rates(state)
    standing.note_velocity(state)
    found = 0
    parity, fusion, compared = redundancy.gyros, state.gyros, state.calibration.gyros
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, fusion = redundancy.accelerometers, state.accelerometers
            compared = state.calibration.accelerometers
        lanes.give_second(memory, lane, kind, parity, fusion, epochs, phases[kind, lane])
        parity.regressors[0] += epochs * (plant.period_ns * 1e-9)
        parity.regressors[OUTER_TURN] += sums[0]
        parity.turned += sums[1]
        sensors_found, _ = watch.close_second(state, parity, fusion)
        found |= sensors_found
        found |= parity.alarm
        calibration_drift.compare(compared, parity, fusion, state.epoch)
        lanes.take_learned(memory, kind, lane, parity)
        if parity.parity.seconds == 0:  # forgot what it had learned
            found = 1
    ins.velocity_n[0], ins.velocity_n[1] = east, north
    return found == 0


@compiled
def _begin_windows(
    rams: Records[Ram], first: int, last: int, phases: Integers, alike: Integers
) -> None:
    """Note where the windows of some runs began, which is nearly always together."""
    for kind in range(2):
        alike[kind] = 1
        for lane in range(LANES):
            redundancy = rams[min(first + lane, last - 1)].redundancy
            parity = redundancy.gyros
            if kind == ACCELEROMETERS:
                parity = redundancy.accelerometers
            phases[kind, lane] = parity.level_epochs
            alike[kind] = alike[kind] and phases[kind, lane] == phases[kind, 0]


@compiled
def begin(
    plants: Records[Plant], rams: Records[Ram], memory: Floats, phases: Integers, alike: Integers
) -> None:
    """Take over the runs where they are, at the end of a second; `memory` has them all."""
    count = plants.shape[0]
    for block in range(memory.shape[0]):
        first, last = block * LANES, min(block * LANES + LANES, count)
        for lane in range(LANES):
            run = min(first + lane, count - 1)
            lanes.take(memory[block], lane, plants[run], rams[run])
        _begin_windows(rams, first, last, phases[block], alike[block])


@compiled
def _follow(
    plants: Records[Plant],
    rams: Records[Ram],
    contract: Contract,
    first: int,
    memory: Floats,
    noise: Floats,
    shared: Floats,
    epoch: int,
    phases: Integers,
    alike: Integers,
    second: Floats,
    lost: Bytes,
    longitude: Floats,
    work: Floats,
    bits: Integers,
    samples: Floats,
    row: int,
    compares: bool | None,
) -> None:
    """Run eight runs over the epochs of `shared`, from `epoch` on; write down what is kept."""
    last = min(first + LANES, plants.shape[0])
    plant, state = plants[first], rams[first]
    layout = contract.sensor[0]
    counts = int(plant.gyros.count), int(plant.accelerometers.count)
    units = float(layout.gyro_dtheta.scale), float(layout.accelerometer_dv.scale)
    levels, dt = int(state.redundancy.gyros.levels), plant.period_ns * 1e-9
    compared, drawn, end = compares is not None, 0, 0
    for e in range(shared.shape[0]):
        if e == end:
            drawn, until_drift = e, plant.drift_epochs - (epoch + e) % plant.drift_epochs
            end += min(SPAN, until_drift, shared.shape[0] - e)
            _prepare(plants, first, last, memory, noise, epoch + e, end - e, lost, work, bits)
        here, drawn_noise = shared[e], noise[e - drawn]
        run_epoch(memory, here, drawn_noise, counts, units, dt, compared, phases, alike, levels)
        second[0] += here[rows.OUTER_TURN]
        second[1] += abs(here[rows.OUTER_TURN])
        second[2] += 1.0
        is_kept, ends_second = here[rows.IS_KEPT] != 0.0, here[rows.ENDS_SECOND] != 0.0
        if is_kept:
            for run in range(first, last):
                lanes.give_sample(memory, run - first, longitude[run], samples[run, row])
            row += 1
        if ends_second:
            for run in range(first, last):
                following = rams[min(run + 1, last - 1)].redundancy
                lanes.fetch_second(following.gyros)
                lanes.fetch_second(following.accelerometers)
                if lost[run]:
                    continue
                own, lane = rams[run], run - first
                own.epoch = epoch + e
                lanes.give_navigation(memory, lane, own.ins, longitude[run])
                if not _close_second(
                    plants[run],
                    own,
                    contract,
                    memory,
                    lane,
                    int(second[2]),
                    phases,
                    here,
                    second,
                    compares,
                ):
                    lost[run] = True
            second[:] = 0.0
            if compares is not None:
                _begin_windows(rams, first, last, phases, alike)


@compiled
def _keep(ins: Ins, sample: Floats) -> None:
    sample[0], sample[1] = ins.latitude, ins.longitude
    sample[2], sample[3] = ins.velocity_n[0], ins.velocity_n[1]


@compiled
def write_navigation(
    leading: Records[Ram], rams: Records[Ram], memory: Floats, longitude: Floats
) -> None:
    """Write the navigation output of all runs in the present epoch."""
    leader = leading[0]
    for run in range(rams.shape[0]):
        own = rams[run]
        own.epoch = leader.epoch
        lanes.give_navigation(memory[run // LANES], run % LANES, own.ins, longitude[run])
        for i in range(3):
            for j in range(3):
                own.C_s_b[i, j] = leader.C_s_b[i, j]
        output(own)


@compiled
def note_lost(
    plants: Records[Plant],
    rams: Records[Ram],
    contracts: Records[Contract],
    memory: Floats,
    lost: Bytes,
) -> None:
    """Note the runs to whose sensors something has happened in the second that has begun last."""
    for run in range(plants.shape[0]):
        own = memory[run // LANES]
        if not _is_clear(plants[run], rams[run], contracts[0], own, run % LANES):
            lost[run] = True


@compiled_with(nogil=True)
def run_together(
    leaders: Records[Plant],
    pieces: Floats,
    leading: Records[Ram],
    contracts: Records[Contract],
    compares: bool | None,
    epochs: int,
    every: int,
    felt: Records[Sensors],
    plants: Records[Plant],
    rams: Records[Ram],
    memory: Floats,
    phases: Integers,
    alike: Integers,
    second: Floats,
    lost: Bytes,
    longitude: Floats,
    shared: Floats,
    noise: Floats,
    work: Floats,
    bits: Integers,
    samples: Floats,
    truth: Records[Truth],
) -> int:
    """Run all runs over some epochs, without other threads having to wait.

    Parameters
    ----------
    leaders, leading : records, one each
        The run that leads.
    felt : Records[Sensors], two
        Bandwidth and latency of gyros and accelerometers, for the frame's axes.
    plants, rams : records, one for each run that follows
        Of none, the leading run goes on alone.
    memory : array, shape (n, `rows.ROWS`, `LANES`)
    phases, alike : array of int, shapes (n, 2, `LANES`) and (n, 2)
        As `run_epoch` takes them.
    second : array, shape (n, 3)
        Sums of the present second: outer turn, its amount, epochs.
    lost : array of bool
        Which runs have to go through all steps.
    longitude : array
        Where each run's lane began, rad.
    shared : array, shape (`AHEAD`, `rows.COLUMNS`)
    noise : array, shape (`SPAN`, sensors, `LANES`)
    work, bits : array
        For `normals`.
    samples : array, shape (1 + runs, n, 4)
        Of the leading run, then of the others, for each epoch that is kept: latitude and longitude
        (rad), velocity to the east and north (m/s).
    truth : records
        The truth in the same epochs.

    Returns
    -------
    int
        Rows written; negative if the leading run is not sound any more.
    """
    plant, state, contract = leaders[0], leading[0], contracts[0]
    second_epochs = 1_000_000_000 // plant.period_ns
    row = 0
    while epochs > 0:
        first, before, count = row, state.epoch, min(AHEAD, epochs)
        for e in range(count):
            here = shared[e]
            _lead(plant, pieces, state, contract, felt, here, compares)
            epoch = state.epoch
            here[rows.ENDS_SECOND] = epoch % second_epochs == 0
            here[rows.IS_KEPT] = epoch % every == 0 and modes.navigating(state)
            if here[rows.IS_KEPT] != 0.0:
                output(state)
                plant.epoch = epoch
                note_truth(plant, pieces)
                plant.epoch = epoch + 1
                _keep(state.ins, samples[0, row])
                truth[row] = plant.truth
                row += 1
            if plants.shape[0] > 0 and not is_sound(state, compares):
                return -1 - row
        epochs -= count
        if plants.shape[0] == 0:
            continue
        for block in range(memory.shape[0]):
            _follow(
                plants,
                rams,
                contract,
                block * LANES,
                memory[block],
                noise,
                shared[:count],
                before + 1,
                phases[block],
                alike[block],
                second[block],
                lost,
                longitude,
                work,
                bits,
                samples[1:],
                first,
                compares,
            )
    return row
