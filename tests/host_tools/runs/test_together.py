"""Runs that share a loop: each is the run that it would be by itself."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.runs.together import rows
from rrins.host_tools.runs.together.conditions import can_share, shared_of
from rrins.host_tools.runs.together.group import Group
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.scenario.tables import Redundancy

RUNS, EVERY = 10, 20
"""More than fit into one vector."""

NOISY = 4
"""A run with a sensor whose noise is not what its data sheet says."""

EPOCHS = 150 * 200 + 1
"""The last sample is of the last epoch, at which a second ends, too."""


def switched_on(run, **keys):
    scenario = load("rimu_rotating").varied(sensors="prototype", seed=run, **keys)
    both = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), EVERY)
    if run == NOISY:
        both.plant["gyros"]["noise_increment"][0, 2] *= 40.0
    return both


@pytest.fixture(scope="module", params=[True, False], ids=["compared", "not compared"])
def runs(request):
    keys = {"redundancy": Redundancy(enabled=request.param)}
    alone = [switched_on(run, **keys) for run in (0, 1, RUNS - 1)]
    tracks = [run.run(EPOCHS) for run in alone]
    group = Group([switched_on(run, **keys) for run in range(RUNS)], EPOCHS, EVERY)
    return group.run(), alone, tracks, group.memory


def test_they_navigate_as_by_themselves(runs):
    together, _, tracks, _ = runs
    for shared, track in zip((together[0], together[1], together[-1]), tracks, strict=True):
        alone = track.navigation
        positions = np.column_stack([alone["latitude"], alone["longitude"]])
        np.testing.assert_allclose(shared.samples[:, :2], positions, rtol=0, atol=1e-14)
        velocities = alone["velocity_n"][:, :2]
        np.testing.assert_allclose(shared.samples[:, 2:], velocities, rtol=0, atol=1e-11)
        for angle in ("roll", "pitch", "heading"):
            found, wanted = float(shared.navigation[angle][0]), float(alone[angle][-1])
            assert found == pytest.approx(wanted, abs=1e-13)
        assert track.truth.tobytes() == shared.truth.tobytes()


def test_they_count_as_by_themselves(runs):
    """What a sensor has not counted yet is the same, or a count comes an epoch too late."""
    _, alone, _, memory = runs
    for lane, run in enumerate(alone[:2]):
        for kind, name in zip(rows.KIND, ("gyros", "accelerometers"), strict=True):
            sensors = run.plant[0][name]
            for k in range(int(sensors.count)):
                row = kind + rows.SENSOR + k * rows.SENSOR_ROWS + rows.REMAINDER
                assert memory[0, row, lane] == pytest.approx(sensors.remainder[k], abs=1e-9)


def test_their_sensors_are_compared_as_by_themselves(runs):
    together, alone, _, _ = runs
    for shared, run in zip((together[1], together[-1]), alone[1:], strict=True):
        for kind in ("gyros", "accelerometers"):
            found, wanted = (one.ram[0].redundancy[kind] for one in (shared, run))
            assert found.seconds == wanted.seconds
            assert found.parity.seconds == wanted.parity.seconds
            assert found.level_epochs == wanted.level_epochs
            noise = float(np.sqrt(wanted.second_variance[0])) or 1.0
            for name in ("level_sum", "window_sum"):
                off = np.abs(found[name][:, 0] - wanted[name][:, 0]).max()
                assert off < 1e-6 * noise, name


def test_a_run_with_an_alarm_goes_its_own_way(runs):
    together, alone, _, _ = runs
    compares = alone[0].compares
    assert (together[NOISY] is None) == bool(compares)
    others = [shared for run, shared in enumerate(together) if run != NOISY]
    assert all(shared is not None for shared in others)
    if compares:
        lonely = switched_on(NOISY)
        lonely.run(EPOCHS)
        assert lonely.ram[0].redundancy.gyros.alarm_epoch > 0


def test_it_stops_when_told():
    group = Group([switched_on(run) for run in range(2)], EPOCHS, EVERY)
    assert group.run(lambda: True) is None
    with pytest.raises(ValueError, match="left, not"):
        group.go_on(EPOCHS)


def of(name, **keys):
    scenario = load(name).varied(**keys)
    return FastRun.of(firmware_settings(scenario), hardware_settings(scenario), EVERY)


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("drive_aided", {}),
        ("rimu_rotating", {"sensors": "ideal"}),
        ("rimu_rotating", {"firmware__height_channel": "damped"}),
        ("rimu_rotating", {"gyros__scale_error_ppm": 20_000.0}),
        ("rimu_rotating", {"gyros__dead_zone_dph": 0.01}),
    ],
)
def test_what_the_loop_leaves_out_is_run_alone(name, keys):
    assert not can_share(of(name, **{"sensors": "prototype"} | keys))


def test_only_runs_on_the_same_way_share_a_loop():
    here = of("rimu_rotating", sensors="prototype")
    other_sensors = of("rimu_rotating", sensors="prototype", seed=7, gyros__bias_dph=0.3)
    elsewhere = of("rimu_rotating", sensors="prototype", site__latitude_deg=10.0)
    other_turns = of("rimu_rotating", sensors="prototype", firmware__turn_rate_dps=3.0)
    assert can_share(here)
    assert shared_of(here) == shared_of(other_sensors)
    assert len({shared_of(each) for each in (here, elsewhere, other_turns)}) == 3
