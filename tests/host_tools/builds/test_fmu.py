"""FMUs are valid to FMPy, and coupled there they navigate as `rrins simulate` does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from rrins.host_tools.builds.build import Build
from rrins.host_tools.builds.fmu import make_fmus
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario
from tests.host_tools.builds.fmus import Coupled

pytestmark = pytest.mark.slow

_EPOCHS = 3000


@pytest.fixture(scope="module")
def fmus(scenario: Scenario, built: Build) -> Mapping[str, Path]:
    made = make_fmus(built.folder, scenario, "imu_rotating", built.images)
    return {path.stem.removeprefix("rrins_"): path for path in made}


def _simulated(scenario: Scenario) -> np.ndarray[Any, Any]:
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    return run.run(_EPOCHS).navigation


def test_they_are_valid(fmus: Mapping[str, Path]) -> None:
    assert {name: validate_fmu(str(path)) for name, path in fmus.items()} == {
        f"{side}.fmi{version}": [] for side in ("firmware", "hardware") for version in (2, 3)
    }


@pytest.mark.parametrize(("version", "is_parallel"), [(3, False), (2, True)])
def test_coupled_they_navigate_as_simulated_in_either_order(
    scenario: Scenario, fmus: Mapping[str, Path], tmp_path: Path, version: int, is_parallel: bool
) -> None:
    coupled = Coupled(fmus, version, tmp_path, is_parallel)
    assert np.array_equal(coupled.run(_EPOCHS), _simulated(scenario))


def test_a_parameter_is_the_scenarios_key_and_a_state_is_the_whole_unit(
    scenario: Scenario, fmus: Mapping[str, Path], tmp_path: Path
) -> None:
    changed = {"gyros.bias_dph[2]": 0.7, "accelerometers.scale_error_ppm[1]": 30.0}
    coupled = Coupled(fmus, 3, tmp_path, hardware=changed)
    before = coupled.run(_EPOCHS // 2)
    state = coupled.save()
    after = coupled.run(_EPOCHS // 2)
    coupled.restore(state)
    assert np.array_equal(coupled.run(_EPOCHS // 2), after)
    gyros = scenario.gyros.model_copy(update={"bias_dph": (0.1, 0.7, 0.1)})
    accelerometers = scenario.accelerometers.model_copy(update={"scale_error_ppm": (30.0, 0, 0)})
    other = scenario.model_copy(update={"gyros": gyros, "accelerometers": accelerometers})
    assert np.array_equal(np.concatenate((before, after)), _simulated(other))


def test_another_seed_draws_other_noise(fmus: Mapping[str, Path], tmp_path: Path) -> None:
    noisy = {f"gyros.angle_random_walk_deg_per_sqrt_h[{k}]": 1.0 for k in (1, 2, 3)}
    runs = [
        Coupled(fmus, 3, tmp_path / str(seed), hardware=noisy | {"seed": seed}).run(700)
        for seed in (0, 1)
    ]
    assert runs[0]["heading"][-1] != runs[1]["heading"][-1]
