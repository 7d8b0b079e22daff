"""Settings for every test."""

from __future__ import annotations

import fcntl
import gc
import os
import re
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

# The first example of a property may compile code. Examples are the same in every run: what chance
# finds is found by `make soak`.
settings.register_profile("test", deadline=None, derandomize=True, max_examples=50)
settings.register_profile("soak", deadline=None, max_examples=1000, print_blob=True)
settings.load_profile("test")

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Matrices are small: threads of BLAS would wait for each other, and for the other worker's, four
# times as long as one computes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What tests start writes bytecode: without, each process compiles all modules for half a second.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@contextmanager
def warnings_as_errors() -> Iterator[None]:
    """Raise each warning; what other tests have left is not collected meanwhile."""
    from rrins.compiled.parts import collector_paused  # and numpy, which reads what is set above

    with collector_paused(), warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


LONGEST = (
    "host_tools/builds/test_diagnostics.py",
    "host_tools/runs/test_redundancy.py",
    "examples/test_own_firmware.py",
    "host_tools/builds/test_build.py",
    "host_tools/runs/test_rehearsal.py",
    "host_tools/runs/test_redundancy_faults.py",
    "host_tools/conformance/test_conformance.py",
    "host_tools/campaigns/test_survival.py",
    "host_tools/experiments/test_reproduce.py",
    "host_tools/runs/test_third_parties.py",
    "host_tools/logs/test_replay.py",
    "host_tools/campaigns/test_cluster.py",
    "test_package.py",
    "docs/test_typed.py",
    "host_tools/dashboard/test_static_page.py",
    "host_tools/dashboard/test_page.py",
)
"""Files that begin, the longest first: else one of them is left to a single worker at the end."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that have no test of the marks asked for: to import all takes ten seconds."""
    marks = config.option.markexpr.split(" or ")
    if collection_path.suffix != ".py" or not all(mark.isidentifier() for mark in marks):
        return None
    text = collection_path.read_text()
    return None if any(f"mark.{mark}" in text for mark in marks) else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files; whoever asks for a soak waits for it."""
    for item in items:
        if item.get_closest_marker("soak"):
            item.add_marker(pytest.mark.timeout(0))
    folder = Path(__file__).parent
    order = {folder / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path, len(order)))


@pytest.fixture(autouse=True)
def _no_test_keeps_the_machine() -> Iterator[None]:
    """Fail a test that leaves its process in real time or bound to a core: all later ones crawl."""
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    yield
    after = os.sched_getscheduler(0), os.sched_getaffinity(0)
    os.sched_setscheduler(0, before[0], os.sched_param(0))
    os.sched_setaffinity(0, before[1])
    assert before == after, "run a side in a process of its own"


def pytest_collection_finish() -> None:
    """Spare the garbage collector all modules and tests: they stay until the end."""
    gc.collect()
    gc.freeze()


_UNEXPLAINED = re.compile(
    r"Traceback|needs to be investigated|Mamma mia|Retries exceeded|: timeout\b", re.IGNORECASE
)


@pytest.fixture(scope="session")
def gallia() -> Callable[..., str]:
    """Return what scans a target with gallia and returns what it said.

    It fails when gallia met something that it cannot explain. RRINS_GALLIA names the program;
    without it, it is looked for in PATH.
    """
    program = os.environ.get("RRINS_GALLIA") or shutil.which("gallia")
    if program is None:
        if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
            pytest.fail("needs gallia")
        pytest.skip("needs gallia")

    def scan(target: str, *words: str) -> str:
        done = subprocess.run(
            [
                *(program, "scan", "uds", *words, "--target", target, "--timeout", "20"),
                *("--no-dumpcap", "--no-volatile-info"),
            ],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"NO_COLOR": "1"},
        )
        said = done.stdout + done.stderr
        assert done.returncode == 0, said[-5000:]
        assert not _UNEXPLAINED.search(said), said[-5000:]
        return said

    return scan


OWN_FIRMWARE = Path(__file__).parents[1] / "examples" / "own_firmware"
RUST_FIRMWARE = OWN_FIRMWARE.with_name("own_firmware_rust")
Shared = AbstractContextManager[Path]
SANITIZED = "-O1 -g -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"


@pytest.fixture(scope="session")
def make_firmware() -> Callable[..., str]:
    """Return a function that runs make for the C firmware, with its products in a folder."""
    for tool in ("gcc", "make"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")

    def make(folder: Path, *words: str, sources: Path = OWN_FIRMWARE) -> str:
        root = OWN_FIRMWARE.parents[1]
        done = subprocess.run(
            [
                *("make", "-C", str(sources), f"PYTHON={sys.executable}", f"CFLAGS={SANITIZED}"),
                *(f"DBC={root / 'dbc' / 'rrins.dbc'}", f"CLIENT={root / 'clients' / 'c'}"),
                *(f"BUILD={folder / 'build'}", f"PROGRAM={folder / 'own_firmware'}", *words),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return make


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Shared]:
    """Return what gives a folder of a name that the workers of a run share, to one at a time."""
    base = tmp_path_factory.getbasetemp()

    @contextmanager
    def folder_of(name: str) -> Iterator[Path]:
        folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
        folder.mkdir(exist_ok=True)
        with folder.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield folder

    return folder_of


@pytest.fixture(scope="session")
def own_firmware(make_firmware: Callable[..., str], shared: Callable[[str], Shared]) -> Path:
    """Return the C firmware: warnings are errors, the sanitizers end it at the first fault."""
    with shared("own_firmware") as folder:
        make_firmware(folder, str(folder / "own_firmware"))
        return folder / "own_firmware"


@pytest.fixture(scope="session")
def rust_firmware(shared: Callable[[str], Shared]) -> Path:
    """Return the firmware in Rust: warnings are errors, an overflow ends it."""
    if shutil.which("rustc") is None:
        pytest.skip("rustc is not installed")
    with shared("own_firmware_rust") as folder:
        program = folder / "own_firmware_rust"
        if not program.exists():
            words = ["rustc", "--edition=2024", "-Dwarnings", "-Copt-level=1", "-Coverflow-checks"]
            source = RUST_FIRMWARE / "src" / "main.rs"
            subprocess.run([*words, source, "-o", program], check=True)
        return program


@pytest.fixture(scope="session")
def largest_difference_m() -> Callable[..., float]:
    """Return what finds the largest horizontal distance of two navigations in common epochs."""
    import numpy as np

    from rrins.compiled.record import Records
    from rrins.firmware_py.core.records.memory import NavigationOutput
    from rrins.host_tools.runs.results.results import east_north_m

    def difference_m(ours: Records[NavigationOutput], theirs: Records[NavigationOutput]) -> float:
        _, i, j = np.intersect1d(ours["epoch"], theirs["epoch"], return_indices=True)
        assert len(i) >= 0.9 * len(ours) > 0
        a, b = ours[i], theirs[j]
        east, north = east_north_m(
            b["latitude"], b["longitude"], a["latitude"], a["longitude"], a["height"]
        )
        return float(np.hypot(east, north).max())

    return difference_m
