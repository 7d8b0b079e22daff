"""Reports of the firmware's estimator: on the bus, and to a diagnostic tool."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.estimator.settings import EstimatorSettings
from rrins.firmware_py.core.frames_out.transmit import OUTBOX_CAPACITY
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.estimator_records import AIDS, ESTIMATOR_HISTORY_S, Aid
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.firmware_py.core.settings import OdometerSettings
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.estimator_identifiers import CONSTANTS

FINE_S = 4


def sheet(white_noise: float, bias_limit: float) -> DataSheet:
    four = (0.0,) * 4
    return DataSheet(
        white_noise=(white_noise,) * 4,
        bias_instability=four,
        rate_random_walk=four,
        temperature_drift=four,
        bias_limit=bias_limit,
    )


SETTINGS = EstimatorSettings(
    gyros=sheet(1e-6, 10 * DPH),
    accelerometers=sheet(1e-4, 0.01),
    fine_alignment_s=FINE_S,
    constants=True,
)
FITTED = {
    "odometer": OdometerSettings(interval_s=0.1, metres_per_pulse=0.01),
    "altimeter": True,
    "height_channel": "damped",
}


@pytest.fixture(scope="module")
def bench(tools):
    """A computer in the middle of its fine alignment, and the frames of the last four seconds."""
    bench = tools.Bench(estimator=SETTINGS, **FITTED)
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_STRAPDOWN)
    bench.sent = []
    for _ in range(FINE_S * 200 + 10 * 200):
        frames = bench.step()
        assert len(frames) <= OUTBOX_CAPACITY
        bench.sent += [tools.decode(frame) for frame in frames]
    return bench


def last(bench):
    estimator = bench.ram[0].estimator
    return estimator.history[(int(estimator.history_count) - 1) % ESTIMATOR_HISTORY_S]


def values_of(bench, name):
    return [values for message, values in bench.sent if message == name]


def test_the_names_of_the_sources_are_those_of_the_contract(tools):
    signal = tools.codec.database.get_message_by_name("ESTIMATOR_SOURCE").get_signal_by_name(
        "source"
    )
    assert {int(k): str(v) for k, v in signal.choices.items()} == {a.value: a.name for a in Aid}
    status = tools.codec.database.get_message_by_name("ESTIMATOR_STATUS")
    assert status.get_signal_by_name("aided_by").length >= AIDS


def test_the_length_of_the_fine_alignment_is_told(bench):
    assert bench.mode == Mode.NAVIGATION_STRAPDOWN
    assert int(bench.ram[0].estimator.aligned_epochs) == FINE_S * 200


def test_sigmas_are_those_of_the_filter(bench):
    estimator = bench.ram[0].estimator
    seconds = estimator.history[: int(estimator.history_count)]  # fewer than fit

    def expected(name, unit, axis, largest):
        return np.minimum(seconds[name][:, axis] / unit, largest)

    for message, name, unit, resolution, largest in (
        ("ESTIMATOR_ATTITUDE", "attitude_sigma", ARCSEC, 0.1, 26214.3),
        ("ESTIMATOR_VELOCITY", "velocity_sigma", 1.0, 0.0001, 26.2143),
        ("ESTIMATOR_POSITION", "position_sigma", 1.0, 0.01, 2621.43),
    ):
        sent = values_of(bench, message)
        assert len(sent) > FINE_S
        for axis, side in enumerate(("east", "north", "up")):
            known = expected(name, unit, axis, largest)
            for values in sent:
                assert np.abs(known - values[f"{side}_sigma"]).min() <= 0.51 * resolution


def test_sensors_and_sources_come_one_after_another(bench):
    gyros = values_of(bench, "ESTIMATOR_GYRO")
    assert np.array_equal(
        np.diff([int(one["sensor"]) for one in gyros]) % 4, [1] * (len(gyros) - 1)
    )
    second = last(bench)
    k = int(gyros[-1]["sensor"]) - 1
    assert gyros[-1]["bias_sigma"] == pytest.approx(second["bias_sigma"][0, k] / DPH, rel=0.01)
    one = values_of(bench, "ESTIMATOR_ACCELEROMETER")[-1]
    k = int(one["sensor"]) - 1
    assert one["bias"] == pytest.approx(second["bias"][1, k] / UG, rel=0.05, abs=0.1)
    sources = [int(one["source"]) for one in values_of(bench, "ESTIMATOR_SOURCE")]
    assert sources == [k % AIDS for k in range(len(sources))]


def test_every_constant_comes_in_its_turn(bench):
    sent = values_of(bench, "ESTIMATOR_CONSTANT")
    found = [(int(one["error"]), int(one["kind"]), int(one["sensor"])) for one in sent]
    order = [(error, kind, k) for error in range(4) for kind in (0, 1) for k in range(1, 5)]
    assert found == [order[k % 32] for k in range(len(found))]
    assert len(found) > 9
    error, kind, sensor = found[-1]
    second, row = last(bench), 4 * kind + error
    sigma = second["constant_sigma"][row, sensor - 1] / PPM
    assert sent[-1]["sigma"] == pytest.approx(sigma, rel=0.05)
    assert sigma > 1


def test_what_is_found_of_odometer_and_altimeter_is_told(bench):
    second = last(bench)
    scale, mounting = (
        values_of(bench, name)[-1] for name in ("ESTIMATOR_ODOMETER", "ESTIMATOR_MOUNTING")
    )
    assert scale["scale_sigma"] == pytest.approx(10_000, rel=1e-3)  # 1 %
    assert mounting["yaw_sigma"] == mounting["pitch_sigma"] == pytest.approx(1.0)
    altimeter = values_of(bench, "ESTIMATOR_ALTIMETER")[-1]
    expected = second["altimeter_bias"], second["altimeter_bias_sigma"]
    assert (altimeter["bias"], altimeter["bias_sigma"]) == pytest.approx(expected, abs=0.2)


def test_what_aids_is_told_while_it_does(bench):
    statuses = values_of(bench, "ESTIMATOR_STATUS")
    standing = 1 << Aid.ZERO_VELOCITY | 1 << Aid.KNOWN_POSITION
    assert int(statuses[1]["aided_by"]) & standing == standing
    assert not int(statuses[-1]["aided_by"]) & 1 << Aid.KNOWN_POSITION
    assert int(statuses[-1]["used"]) > 0


def test_without_an_estimator_nothing_is_sent(tools):
    bench = tools.Bench()
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    names = {tools.decode(frame)[0] for _ in range(400) for frame in bench.step()}
    assert not [name for name in names if name.startswith("ESTIMATOR")]


def test_a_tool_reads_them(bench):
    computer = bench.firmware.diagnostics._computer
    second = last(bench)

    def read(name):
        did = table.identifier(name)
        return did.layout.named(did.decode(computer.read(did)))

    found = read("estimator_sigma")
    assert found["aligned_epochs"] == FINE_S * 200
    assert found["attitude_sigma_arcsec"] == pytest.approx(second["attitude_sigma"] / ARCSEC)
    assert found["position_sigma_m"] == pytest.approx(second["position_sigma"])
    sources = read("estimator_sources")
    assert sources["used"] == tuple(second["used"])
    assert len(sources["nis"]) == AIDS
    assert read("estimator_gyros")["estimated_bias_dph"] == pytest.approx(second["bias"][0] / DPH)
    sigma = read("estimator_accelerometers")["estimated_bias_sigma_ug"]
    assert sigma == pytest.approx(second["bias_sigma"][1] / UG)
    aids = read("estimator_aids")
    assert aids["odometer_scale_sigma_ppm"] == pytest.approx(1e4, rel=1e-3)
    assert aids["mounting_sigma_deg"] == pytest.approx((1.0, 1.0))
    assert aids["altimeter_bias_sigma_m"] == pytest.approx(second["altimeter_bias_sigma"])
    for kind, one in enumerate(("gyro", "accelerometer")):
        constants = read(f"estimator_{one}_constants")
        for error, (name, unit) in enumerate(CONSTANTS):
            row = 4 * kind + error
            value, sigma = constants[f"{one}_{name}"], constants[f"{one}_{name}_sigma"]
            assert value == pytest.approx(second["constant"][row] / unit)
            assert sigma == pytest.approx(second["constant_sigma"][row] / unit)
