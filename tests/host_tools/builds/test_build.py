"""What is built is what was rehearsed: the same frames, the same memory."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest

from rrins.host_tools.builds import toolchain
from rrins.host_tools.builds.build import MANIFEST, Build, build
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.cli.unit import build as command
from rrins.host_tools.scenario.scenario import Scenario, load
from tests.host_tools.builds.steps import first_difference, shared_library

pytestmark = pytest.mark.slow

_SCENARIOS = (
    "ideal", "rimu_rotating", "rimu_rotating_aligned", "drive_aided", "ship_moored", "tour",
)  # fmt: skip


def test_machine_code_gives_the_same_frames_and_memory(
    scenario: Scenario, built: Build, tmp_path: Path
) -> None:
    library = shared_library(built, tmp_path)
    assert first_difference(scenario, built, library, 60 * scenario.rate_hz) is None


@pytest.mark.soak
@pytest.mark.parametrize("name", _SCENARIOS)
def test_machine_code_gives_the_same_over_whole_scenarios(name: str, tmp_path: Path) -> None:
    scenario = load(name)
    done = build(scenario, name, "x86_64-linux", tmp_path)
    library = shared_library(done, tmp_path)
    assert first_difference(scenario, done, library, scenario.epochs + 1) is None


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
