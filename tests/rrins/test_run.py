"""Runs from Python: the same results as the command line's, as datasets and pictures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

import rrins

KEYS = {"duration_s": 20, "gyro_bias_dph": [0.1, 0.11, 0.12, 0.13]}


@pytest.fixture(scope="module")
def run():
    return rrins.simulate("rimu_rotating", progress=False, **KEYS)


@pytest.fixture(scope="module")
def rehearsed(tmp_path_factory):
    log = tmp_path_factory.mktemp("rehearsed") / "bus.log"
    return rrins.rehearse("rimu_rotating", record=log, progress=False, **KEYS), log


@pytest.mark.slow
def test_errors_are_navigation_minus_truth(run):
    errors = run.errors
    height = run.navigation.height - run.truth.height
    np.testing.assert_array_equal(errors.position_n.sel(axis="up"), height)
    velocity = run.navigation.velocity_n - run.truth.velocity_n
    np.testing.assert_array_equal(errors.velocity_n, velocity)
    largest = abs(errors.position_n).max("time")
    figures = run.summary["max_abs_position_error_m"]
    assert largest.sel(axis="east").item() == figures["east"] > 0
    assert largest.sel(axis="north").item() == figures["north"] > 0


def test_everything_has_its_unit(run):
    for dataset in (run.errors, run.navigation, run.truth, run.turntable):
        assert dataset.time.units == "s"
        for name, variable in dataset.data_vars.items():
            assert variable.attrs["long_name"], name
            assert name == "mode" or variable.attrs["units"] in ("m", "m/s", "deg")
    assert float(run.errors.time[-1]) == KEYS["duration_s"]


@pytest.fixture(scope="module")
def broken():
    """A run in which gyro 3 fails after 10 s of navigation; GNSS aids it."""
    fault = {"kind": "gyro_bias", "sensor": 3, "bias_dph": 2000, "at_s": 13}
    return rrins.simulate(
        "drive_aided", progress=False, duration_s=20, integrity__enabled=True, faults=[fault]
    )


@pytest.mark.slow
def test_more_of_a_run_has_its_units(broken):
    datasets = (broken.sigma, broken.estimates, broken.parity, broken.increments)
    for dataset in datasets:
        assert dataset.time.units == "s"
        for name, variable in dataset.data_vars.items():
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
    assert set(broken.sigma.data_vars) == {"position_n", "velocity_n", "attitude_n"}
    assert "horizontal_protection" in broken.estimates
    ratio = abs(broken.errors.position_n) / broken.sigma.position_n  # of the same epochs
    assert 0 < float(ratio.mean()) < 3
    assert len(ratio.time) == len(broken.sigma.time)


@pytest.mark.slow
def test_parity_ends_with_the_redundancy_and_events_say_why(broken):
    parity = broken.parity
    assert float(parity.gyro_ratio.max()) > 1 > float(parity.accelerometer_ratio.max())
    assert np.isnan(parity.gyro_ratio[-1])
    assert np.isnan(parity.gyro_residual[-1]).all()
    assert not np.isnan(parity.accelerometer_residual[-1]).any()
    events = broken.events
    assert list(events.columns) == ["time_s", "kind", "text"]
    assert events.time_s.is_monotonic_increasing
    (exclusion,) = events[events.kind == "exclusion"].text
    assert exclusion.startswith("gyro 3 left out")
    assert (events.text == "gyro_bias (sensor 3)").sum() == 1


@pytest.mark.slow
def test_increments_are_those_of_the_frames(rehearsed):
    run, path = rehearsed
    on_bus = rrins.open_log(path)["SENSOR_2"]
    mine = run.increments.sel(sensor=2)
    count = min(len(on_bus.time), len(mine.time))
    assert count > 4000
    for ours, theirs in (("gyro", "gyro_dtheta_rad"), ("accelerometer", "accelerometer_dv_mps")):
        np.testing.assert_array_equal(mine[ours][:count], on_bus[theirs][:count])


def test_what_a_run_does_not_have_is_one_line(run):
    with pytest.raises(rrins.RehearsalError, match="estimator__enabled=True"):
        _ = run.sigma


def test_progress_in_a_notebook_is_one_line(monkeypatch):
    shown = []

    class Handle:
        def update(self, data, raw):
            shown.append(data["text/plain"])

    def display(data, raw, display_id):
        shown.append(data["text/plain"])
        return Handle()

    monkeypatch.setattr("IPython.display.display", display)
    monkeypatch.setattr("rrins.run.is_notebook", lambda: True)
    rrins.simulate("ideal", duration_s=30)
    assert shown[0] == "preparing"
    assert not any("\n" in line for line in shown)
    assert shown[-1].startswith(" ") or shown[-1].startswith("100 %")


def test_the_turntable_turned(run):
    assert float(abs(run.turntable.angle.sel(table_axis="inner")).max()) > 30
    modes = dict(
        zip(
            run.navigation.mode.flag_values,
            run.navigation.mode.flag_meanings.split(),
            strict=True,
        )
    )
    assert modes[int(run.navigation.mode[-1])] == "NAVIGATION_ROTATING"


def test_a_table_has_the_columns_of_the_file(run, tmp_path):
    table = run.to_pandas()
    paths = run.save(tmp_path / "saved")
    (csv,) = [path for path in paths if path.name == "errors.csv"]
    head = csv.read_text().splitlines()[0].split(",")
    assert [table.index.name, *table.columns] == [head[1], head[0], *head[2:]]
    assert json.loads((tmp_path / "saved" / "summary.json").read_text()) == json.loads(
        json.dumps(run.summary)
    )


def test_pictures_can_be_drawn_into(run):
    figure = Figure()
    assert run.plot_errors(figure) is figure
    assert [axes.get_xlabel() for axes in figure.axes][-1].endswith("/ s")
    axes = Figure().subplots()
    assert run.plot_track(axes) is axes
    assert run.plot_track().get_figure() is not None


def test_it_shows_itself(run):
    assert "20 s" in repr(run)
    shown = run._repr_html_()
    assert "largest error" in shown
    assert "data:image/png;base64," in shown
    assert run.summary["navigation_sha256"][:16] in shown


@pytest.mark.slow
def test_a_rehearsal_gives_the_same_object(run, rehearsed):
    other, _ = rehearsed
    assert type(other) is type(run)
    assert other.summary["navigation_sha256"] == run.summary["navigation_sha256"]
    assert other.errors.equals(run.errors)
    assert set(other.summary) == {*run.summary, "speed"}


@pytest.mark.slow
def test_its_log_by_signal(rehearsed):
    run, path = rehearsed
    log = rrins.open_log(path)
    assert log.messages["SYNC"] == run.summary["epochs"]
    assert "NAV_HEIGHT.height_m" in log.signals
    height = log["NAV_HEIGHT.height"]
    assert height.units == "m"
    assert abs(float(height[-1]) - float(run.navigation.height[-1])) < 0.01
    table = log.to_pandas("NAV_VELOCITY")
    assert table.index.name == "time_s"
    assert "velocity_east_mps" in table
    assert "NAV_HEIGHT" in log._repr_html_()
    assert log.damage is None
    with pytest.raises(rrins.RehearsalError, match="NAV_HEIGHT"):
        _ = log["NAV_HEIGT.height"]
    message = log["NAV_HEIGHT"]
    assert f"NAV_HEIGHT.{next(iter(message.data_vars))}" in log.signals
    assert log["NAV_HEIGHT.height_m"].identical(height)
    assert message.height_m.identical(height)
    assert height.name == "height_m"


@pytest.mark.slow
def test_its_log_navigates_again_to_the_same_bytes(rehearsed):
    run, path = rehearsed
    again = rrins.replay(path)
    assert again["firmware"]["navigation_sha256"] == run.summary["navigation_sha256"]
    assert again["comparison"]["is_same"]


def test_what_cannot_begin_is_raised():
    with pytest.raises(rrins.RehearsalError, match="channel"):
        rrins.rehearse("rimu_rotating", interface="socketcan", progress=False, duration_s=1)


def test_a_firmware_in_fault_is_a_result():
    faults = [{"kind": "silence", "node": "hardware", "at_s": 5}]
    run = rrins.simulate("rimu_rotating", duration_s=10, faults=faults, progress=False)
    assert run.summary["firmware"]["fault"] == "SENSORS_LOST"
