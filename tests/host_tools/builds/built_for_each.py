"""A navigation computer for each set-up: runs the program that was built for a scenario.

    python built_for_each.py FOLDER [EMULATOR …] --setup SCENARIO.firmware/setup.txt …

`rrins conform` sets a program up in many ways, and one of `rrins build` has one set-up. Where there
is no program for a scenario yet, its file goes into the folder, and this ends with status 3.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path

WANTED = "*.toml"


def place(scenario_file: Path, folder: Path) -> Path:
    """Return where the program for a scenario is, or has to be."""
    return folder / hashlib.sha256(scenario_file.read_bytes()).hexdigest()[:16]


if __name__ == "__main__":
    folder, *words = sys.argv[1:]
    first = words.index("--setup")
    scenario_file = Path(words[first + 1]).parent.with_suffix(".toml")
    path = place(scenario_file, Path(folder))
    if not path.exists():
        shutil.copyfile(scenario_file, path.with_suffix(WANTED[1:]))
        sys.exit(3)
    program = [*words[:first], str(path), *words[first:]]
    os.execvp(program[0], program)
