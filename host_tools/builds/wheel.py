"""Objects for a wheel: what everyday commands call, so that the first start compiles nothing.

``make wheel`` runs this module, then builds the wheel. The objects are for any processor of this
kind of machine.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rrins.compiled.code_folder import KEY, SHIPPED, CodeFolder, shipped_key
from rrins.host_tools.terminal import new_console

_SCENARIOS = "rimu_rotating", "imu_rotating", "drive_aided", "rimu_rotating_aligned"
"""With and without redundant sensors, and with and without the filter."""

_COMMANDS = "simulate", "rehearse"


def ship(folder: Path = SHIPPED) -> int:
    """Fill a folder of the package with objects; return their number.

    Parameters
    ----------
    folder : Path
        Whatever is there goes.

    Raises
    ------
    subprocess.CalledProcessError
        When a command fails; what it said is on standard error.
    """
    shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="rrins-") as name:
        work = Path(name)
        environment = os.environ | {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": name}
        for scenario in _SCENARIOS:
            for command in _COMMANDS:
                words = [command, scenario, "--duration=1", f"--out={work / 'out'}"]
                program = [sys.executable, "-m", "rrins", *words]
                subprocess.run(program, check=True, env=environment, stdout=subprocess.DEVNULL)
        (kept,) = (path for path in (work / "rrins").iterdir() if path.is_dir())
        found = [path.name for path in kept.glob("*.code") if ".part-" not in path.name]
        folder.mkdir(parents=True)
        for file in found:
            (folder / file).write_bytes(CodeFolder(kept).load(file) or b"")
        (folder / KEY).write_text(shipped_key())
    return len(found)


if __name__ == "__main__":
    new_console().print(f"{ship()} objects in {SHIPPED}")
