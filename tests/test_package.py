"""The wheel, installed elsewhere: one package, and all that the command needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINKED = ("dbc", "firmware_py", "host_tools")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return the folder with the wheel and the archive of the sources that it was built from."""
    folder = tmp_path_factory.mktemp("built")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def installed(built):
    (wheel,) = built.glob("*.whl")
    target = built / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


@pytest.fixture
def own_folder(tmp_path):
    """Return a folder of a user whose own modules have the names of our folders."""
    (tmp_path / "dbc.py").write_text("mine = True\n")
    for name in ("firmware_py", "host_tools"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("mine = True\n")
    return tmp_path


def environment(installed):
    # In plain Python: the place of the files is new to the compiler, which would begin anew.
    return os.environ | {"PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}


def run(installed, folder, *arguments):
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment(installed),
        check=True,
        capture_output=True,
        text=True,
    )


def test_there_is_one_name_at_the_top(installed):
    assert {path.name for path in installed.iterdir() if path.suffix != ".dist-info"} == {"rrins"}
    assert (installed / "rrins" / "py.typed").is_file()
    assert list(installed.glob("rrins-*.dist-info/licenses/LICENSE"))


def test_it_holds_every_module_and_every_file_of_data(installed):
    for room in LINKED:
        for path in (ROOT / room).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                assert (installed / "rrins" / path.relative_to(ROOT)).is_file(), path


def test_the_sources_are_those_of_the_repository(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as sources:
        names = {name.partition("/")[2] for name in sources.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "rrins/host_tools/cli/main.py"} <= names


def test_a_user_s_own_dbc_is_in_nobody_s_way(installed, own_folder):
    where = run(installed, own_folder, "-c", "import rrins.host_tools; print(rrins.__file__)")
    assert where.stdout.startswith(str(installed))
    script = "import dbc, firmware_py, host_tools; assert dbc.mine and firmware_py.mine"
    run(installed, own_folder, "-c", f"import rrins; {script} and host_tools.mine")


def test_the_command_works_in_a_user_s_folder(installed, own_folder):
    (own_folder / "own.toml").write_text(
        "duration_s = 0.1\nrate_hz = 50\n[firmware]\nalignment_s = 0.1\n"
    )
    words = ("-m", "rrins", "simulate", "own.toml", "--json")
    assert json.loads(run(installed, own_folder, *words).stdout)["completed"]


def test_the_plugin_and_the_bus_work_in_a_user_s_folder(own_folder):
    # By their entry points, as installed where these tests run.
    (own_folder / "test_own.py").write_text(
        "import can\n"
        "import dbc\n\n"
        "def test_bus(rrins_bus, rrins_channel):\n"
        "    assert dbc.mine\n"
        "    with can.Bus(interface='rrins', channel=rrins_channel) as other:\n"
        "        other.send(can.Message(arbitration_id=5, is_extended_id=False))\n"
        "    assert rrins_bus.recv(5).arbitration_id == 5\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"],
        cwd=own_folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_editors_find_an_editable_install():
    site = Path(sysconfig.get_path("purelib"))
    (direct,) = site.glob("rrins-*.dist-info/direct_url.json")
    if not json.loads(direct.read_text()).get("dir_info", {}).get("editable"):
        pytest.skip("not an editable install")
    paths = [line for file in site.glob("*rrins*.pth") for line in file.read_text().splitlines()]
    assert paths, "no static path: mypy and editors would not find the package"
    assert all((Path(path) / "rrins" / "py.typed").is_file() for path in paths)


def test_a_clone_called_rrins_is_in_nobody_s_way(tmp_path):
    (tmp_path / "rrins" / "rrins").mkdir(parents=True)
    script = "import rrins; print(rrins.scenario_names())"
    told = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "ideal" in told.stdout
