"""Plotting libraries are loaded once the sides run, not before."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys, threading
import rrins.host_tools.cli.run.run, rrins.host_tools.runs.run
from rrins.host_tools.runs.results.picture_loading import PictureLoading
with PictureLoading() as pictures:
    if {begins}:
        pictures.begin()
        pictures.begin()
        assert threading.active_count() <= 2
assert threading.active_count() == 1
print("matplotlib" in sys.modules)
"""


def loads_pictures(begins: bool) -> bool:
    program = PROGRAM.format(begins=begins)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout == "True\n"


def test_nothing_is_loaded_before_it_begins():
    assert not loads_pictures(begins=False)


def test_all_is_loaded_when_it_closes():
    assert loads_pictures(begins=True)
