"""The follower of a user's firmware: nothing of it is compiled while time is real."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

SCRIPT = """
import json
import numpy as np
from rrins.compiled.compile_events import compiling_watched
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import frame_array
from rrins.host_tools.runs.programs.follower import follower_of

NAMES = "firmware_status firmware_faults nav_latitude nav_longitude nav_velocity nav_height".split()
frames = frame_array(7)
for frame, name in zip(frames, [*NAMES, "nav_attitude"]):
    fill(frame, getattr(load_contract()[0], name).message, np.uint64(0), 3)
follower = follower_of(None)
compiled = []
with compiling_watched(compiled.append):
    follower.take(frames, len(frames), 0)
summary = follower.summary(0)
print(json.dumps([compiled, summary["frames_sent"], summary["epochs_navigated"]]))
"""


@pytest.mark.slow
def test_no_frame_waits_for_a_compiler(tmp_path):
    """A compiler that ran at the first navigation frame would cost a rehearsal in real time."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [[], 7, 1]
