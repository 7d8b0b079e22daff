"""Parity, residuals and estimates of a run: every second is written down, and drawn."""

from __future__ import annotations

import numpy as np
import pytest

import rrins
from rrins.firmware_py.core.records.memory import blank_ram
from rrins.firmware_py.core.records.redundancy_records import HISTORY_S
from rrins.host_tools.runs.results.parity_plot import draw_parity
from rrins.host_tools.runs.results.seconds_log import SecondsLog, take_seconds

RATE_HZ, DURATION_S, FAULT_S = 200, 70, 43
DPH = np.radians(1.0) / 3600
FAULT = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 100, "at_s": FAULT_S}


@pytest.fixture(scope="module")
def runs():
    """The same run in one loop, and by frames."""
    changes = {"duration_s": DURATION_S, "redundancy": {"enabled": True}, "faults": [FAULT]}
    changes |= {"sensors": "prototype", "gyros": {}, "accelerometers": {}}
    return [rrins.simulate("rimu_rotating", frames=way, **changes)._result for way in (False, True)]


def test_every_second_is_there_whichever_way_it_was_run(runs):
    fast, frames = (run.seconds.parities for run in runs)
    for kind in ("gyros", "accelerometers"):
        uneven = np.diff(fast[kind]["epoch"]) != RATE_HZ  # navigation begins seconds of its own
        assert np.count_nonzero(uneven) <= 1
        assert len(fast[kind]) > DURATION_S
        assert fast[kind].tobytes() == frames[kind].tobytes()


def test_the_fault_is_in_it(runs):
    seconds = runs[0].seconds.parities["gyros"]
    before = seconds["epoch"] < FAULT_S * RATE_HZ
    assert np.all(seconds["sensors"][before] == 0b1111)
    assert np.all(seconds["ratio"][before] < 1)
    at = int(np.argmax(np.abs(seconds["residual"][:, 0])))
    assert 0 <= seconds["epoch"][at] - FAULT_S * RATE_HZ <= 2 * RATE_HZ
    assert seconds["ratio"][at] > 1
    # On a tetrahedron a quarter of a fault is in each residual, and noise beside it.
    residual_dph = np.abs(seconds["residual"][at, :4]) / DPH
    assert residual_dph == pytest.approx(25, abs=3)  # the whole second
    assert np.all(residual_dph > seconds["threshold"][at, :4] / DPH)
    assert np.all(seconds["sensors"][at + 1 :] == 0b1101)
    assert not seconds["threshold"][at + 1 :].any()  # three are never compared


def test_a_residual_is_beyond_its_threshold_only_where_the_parity_is():
    parity = rrins.simulate("rimu_rotating", duration_s=60).parity  # learns with its first turn
    for kind in ("gyro", "accelerometer"):
        residual, threshold, ratio = (
            parity[f"{kind}_{name}"].to_numpy() for name in ("residual", "threshold", "ratio")
        )
        assert ratio.max() < 1
        assert np.all(np.abs(residual) < threshold)


@pytest.mark.pictures
def test_the_picture_is_written(runs, tmp_path):
    assert tmp_path / "parity.png" in runs[0].write(tmp_path)
    assert (tmp_path / "parity.png").stat().st_size > 10_000
    figure = draw_parity(runs[0].seconds.parities, 0.0, RATE_HZ, "a title")
    ratio, residuals, *accelerometers = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "gyro parity\n/ threshold",
        "gyro residuals\n/ (°/h)",
        "accelerometer parity\n/ threshold",
        "accelerometer residuals\n/ µg",
    ]
    words = [text.get_text() for text in ratio.texts]
    assert words == ["threshold", "no redundancy left", "gyro 2 left out"]
    assert [text.get_text() for text in residuals.texts] == ["left out"]
    named = [label.get_text() for label in residuals.get_yticklabels()]
    assert [name.split("  ")[0] for name in named if "gyro" in name] == [
        f"gyro {k}" for k in (1, 2, 3, 4)
    ]
    # With three there is nothing to compare: a gap, not a line at 0.
    time_s, values = ratio.lines[0].get_data()
    assert np.isnan(values[time_s > FAULT_S + 2]).all()
    assert np.isfinite(values[time_s < FAULT_S]).all()
    texts = [text.get_text() for axes in accelerometers for text in axes.texts]
    assert texts == ["threshold"]


@pytest.mark.pictures
def test_the_scale_of_residuals_does_not_follow_the_first_second_or_the_fault(runs):
    seconds = runs[0].seconds.parities["gyros"]
    figure = draw_parity({"gyros": seconds}, 0.0, RATE_HZ, "")
    low, high = figure.axes[1].get_ylim()
    settled_dph = np.median(seconds["threshold"][:40, 0]) / DPH
    assert (high - low) / 4 < 4 * settled_dph  # a strip of four, both signs
    assert np.abs(seconds["residual"]).max() / DPH > (high - low) / 4


def test_without_redundancy_there_is_none(tmp_path):
    run = rrins.simulate("ideal", duration_s=5, redundancy={"enabled": False})._result
    assert run.seconds.parities == {}
    assert not [path for path in run.write(tmp_path) if path.name == "parity.png"]


def note(rings, seconds):
    """Note seconds as the firmware does."""
    for ring in rings:
        for second in seconds:
            row = ring.history[int(ring.history_count) % HISTORY_S]
            row["epoch"] = second
            if "ratio" in row.dtype.names:
                row["ratio"] = 2.0 if second == 1234 else 0.5
            ring["history_count"] += 1


def test_a_very_long_run_is_thinned_but_for_alarms(tmp_path):
    ram = blank_ram()
    redundancy, estimator = ram[0].redundancy, ram[0].estimator
    for record in (redundancy, estimator):
        record["enabled"] = True
        record["second_epochs"] = 10
    rings = (redundancy.gyros, redundancy.accelerometers, estimator)
    log = SecondsLog(ram, tmp_path, 1_000_000)
    assert log.every == 160
    for begin in range(0, 2000, 16):
        note(rings, range(begin, begin + 16))
        log.run()
    redundancy.gyros["history_count"] = 0  # a reset
    note(rings[:1], range(5000, 5001))
    log.run()
    log.close()
    found = take_seconds(tmp_path)
    tenths = [*range(0, 2000, 10)]
    assert list(found.parities["gyros"]["epoch"]) == [*sorted([*tenths, 1234]), 5000]
    assert len(found.parities["accelerometers"]) == 201
    assert list(found.estimates["epoch"]) == tenths
    assert list(tmp_path.iterdir()) == []
