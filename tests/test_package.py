"""The wheel, installed elsewhere, carries all that the command needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


def run(installed, *arguments):
    # In plain Python: the place of the files is new to the compiler, which would begin anew.
    environment = os.environ | {"PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}
    return subprocess.run(
        [sys.executable, "-m", "host_tools", *arguments],
        cwd=installed.parent,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )


def test_the_wheel_holds_contract_scenarios_and_licence(installed):
    assert (installed / "dbc" / "rrins.dbc").is_file()
    assert (installed / "host_tools" / "scenarios" / "rimu_rotating.toml").is_file()
    assert not (installed / "tests").exists()
    assert list(installed.glob("rrins-*.dist-info/licenses/LICENSE"))


def test_the_command_works_from_the_wheel(installed):
    where = subprocess.run(
        [sys.executable, "-c", "import host_tools; print(host_tools.__file__)"],
        cwd=installed.parent,
        env=os.environ | {"PYTHONPATH": str(installed)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert where.stdout.startswith(str(installed))
    assert "rimu_rotating" in run(installed, "scenarios").stdout
    out = run(installed, "simulate", "ideal", "--duration", "1", "--json").stdout
    assert json.loads(out)["epochs"] == 802
