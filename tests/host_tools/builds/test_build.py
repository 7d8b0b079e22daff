"""What is built is what was rehearsed: the same frames, the same memory."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.validation import validate_fmu

import rrins
from rrins.host_tools.builds import navigator, toolchain
from rrins.host_tools.builds.build import MANIFEST, Build, build
from rrins.host_tools.builds.fmu import make_fmus
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.cli.unit import build as command
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario, load
from tests.host_tools.builds.fmus import Coupled
from tests.host_tools.builds.steps import (
    EMULATORS,
    first_difference,
    frames_that_differ,
    program,
    shared_library,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first of a machine compiles all

_EPOCHS = 3000
"""Of units coupled; they navigate from the 600th on."""

_FAULT = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 10, "at_s": 600}
_SCENARIOS: Mapping[str, Mapping[str, Any]] = {
    "ideal": {},
    "rimu_rotating": {},
    "rimu_rotating_aligned": {},
    "drive_aided": {},
    "ship_moored": {},
    "tour": {"faults": [_FAULT]},
}


def test_machine_code_gives_the_same_frames_and_memory(
    scenario: Scenario, built: Build, tmp_path: Path
) -> None:
    library = shared_library(built, tmp_path)
    assert first_difference(scenario, built, library, 60 * scenario.rate_hz) is None


@pytest.mark.soak
@pytest.mark.parametrize("name", _SCENARIOS)
def test_machine_code_gives_the_same_over_whole_scenarios(name: str, tmp_path: Path) -> None:
    scenario = load(name, **_SCENARIOS[name])
    done = build(scenario, name, "x86_64-linux", tmp_path)
    library = shared_library(done, tmp_path)
    assert first_difference(scenario, done, library, scenario.epochs + 1) is None


@pytest.mark.soak
@pytest.mark.parametrize("name", _SCENARIOS)
def test_other_processors_send_the_same_frames_over_whole_scenarios(
    name: str, tmp_path: Path
) -> None:
    scenario = load(name, **_SCENARIOS[name])
    programs = []
    for target, emulator in EMULATORS.items():
        if emulator and shutil.which(emulator[0]) is None:
            pytest.skip(f"needs {emulator[0]}: Debian's qemu-user and nodejs")
        programs.append(program(build(scenario, name, target, tmp_path / target)))
    frames, differing = frames_that_differ(scenario, programs, scenario.epochs + 1)
    # All have one C library's mathematics, Python another's: a number may be rounded otherwise.
    assert differing <= 1e-5 * frames


def has_the_digest_of_python(scenario: Scenario, built: Build) -> bool:
    """Return whether the program of a build navigates to the bit as Python does."""
    system = TARGETS[built.target].system
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    assert toolchain.links_own_programs(system), "needs the static C library: libc6-dev"
    program = navigator.link(built.folder, TARGETS[built.target], built.images)
    done = rrins.rehearse(scenario, program=str(program))
    digest = rrins.simulate(scenario).summary["navigation_sha256"]
    return bool(done.summary["navigation_sha256"] == digest)


def test_the_program_navigates_as_python_does_to_the_bit(built: Build) -> None:
    assert has_the_digest_of_python(load("imu_rotating", duration_s=20.0), built)


@pytest.mark.soak
@pytest.mark.parametrize("name", _SCENARIOS)
def test_the_program_navigates_so_through_whole_scenarios(name: str, tmp_path: Path) -> None:
    scenario = load(name, **_SCENARIOS[name])
    assert has_the_digest_of_python(scenario, build(scenario, name, "x86_64-linux", tmp_path))


def test_the_memory_has_no_room_for_what_the_scenario_does_not_ask_for(built: Build) -> None:
    assert built.memory_bytes["firmware"] < 512_000


def test_the_manifest_tells_what_is_there(built: Build) -> None:
    manifest = json.loads((built.folder / MANIFEST).read_text())
    for name, digest in manifest["sha256"].items():
        assert hashlib.sha256((built.folder / name).read_bytes()).hexdigest() == digest
    assert set(manifest["sha256"]) | {MANIFEST} == {path.name for path in built.files}


@pytest.mark.parametrize("target", [name for name in TARGETS if "linux" in name])
def test_the_c_of_the_readme_compiles_and_sees_the_memory_as_it_is(
    built: Build, target: str, tmp_path: Path
) -> None:
    readme = (built.folder / "README.md").read_text()
    (code,) = re.findall(r"```c\n(.*?)```", readme, re.DOTALL)
    size = built.memory_bytes["firmware"]
    check = f'_Static_assert(sizeof ram == {size} && sizeof(struct rrins_frame) == 16, "");\n'
    (tmp_path / "navigate.c").write_text(code + check)
    include = "-I", built.folder
    strict = "-Wall", "-Wextra", "-Wpedantic", "-Werror"
    toolchain.zig(
        "cc", "-target", TARGETS[target].system, *strict, *include, "-c",
        tmp_path / "navigate.c", "-o", tmp_path / "navigate.o",
    )  # fmt: skip


def test_targets_are_named_where_they_are_chosen() -> None:
    (option,) = (each for each in command.build.params if each.name == "target")
    assert list(TARGETS) == list(option.type.choices)  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def fmus(scenario: Scenario, built: Build) -> Mapping[str, Path]:
    made = make_fmus(built.folder, scenario, "imu_rotating", built.images)
    return {path.stem.removeprefix("rrins_"): path for path in made}


def _simulated(scenario: Scenario, epochs: int = _EPOCHS) -> np.ndarray[Any, Any]:
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    return run.run(epochs).navigation


def test_fmus_are_valid(fmus: Mapping[str, Path]) -> None:
    assert {name: validate_fmu(str(path)) for name, path in fmus.items()} == {
        f"{side}.fmi{version}": [] for side in ("firmware", "hardware") for version in (2, 3)
    }


@pytest.mark.parametrize(("version", "is_parallel"), [(3, False), (2, True)])
def test_fmus_coupled_navigate_as_simulated_in_either_order(
    scenario: Scenario, fmus: Mapping[str, Path], tmp_path: Path, version: int, is_parallel: bool
) -> None:
    coupled = Coupled(fmus, version, tmp_path, is_parallel)
    assert np.array_equal(coupled.run(_EPOCHS), _simulated(scenario))


@pytest.mark.soak
@pytest.mark.parametrize("name", ["tour", "drive_aided", "rimu_rotating"])
def test_fmus_navigate_so_through_whole_scenarios(name: str, tmp_path: Path) -> None:
    scenario = load(name)
    files = build(scenario, name, "x86_64-linux", tmp_path, fmus=True).files
    units = {path.stem.removeprefix("rrins_"): path for path in files if path.suffix == ".fmu"}
    epochs = scenario.epochs + 1
    coupled = Coupled(units, 3, tmp_path)
    assert np.array_equal(coupled.run(epochs), _simulated(scenario, epochs))


def test_a_parameter_of_an_fmu_is_the_scenarios_key_and_its_state_is_all_of_it(
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


def test_another_seed_of_an_fmu_draws_other_noise(fmus: Mapping[str, Path], tmp_path: Path) -> None:
    noisy = {f"gyros.angle_random_walk_deg_per_sqrt_h[{k}]": 1.0 for k in (1, 2, 3)}
    runs = [
        Coupled(fmus, 3, tmp_path / str(seed), hardware=noisy | {"seed": seed}).run(700)
        for seed in (0, 1)
    ]
    assert runs[0]["heading"][-1] != runs[1]["heading"][-1]
