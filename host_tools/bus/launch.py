"""Starts a separate hub process when nobody hosts a channel yet."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

from rrins.host_tools.bus.channel import NoHostError
from rrins.host_tools.bus.hub import READY
from rrins.host_tools.bus.link import Link
from rrins.host_tools.errors import BusError

_ROOT: Final = Path(__file__).parents[3]


def start_hub(channel: str) -> str:
    """Start a hub in the background, which ends by itself when its last peer has left.

    Parameters
    ----------
    channel : str
        Name or path of the channel.

    Returns
    -------
    str
        Empty when the channel can be attached to, be it that another process was faster; else why
        it cannot be hosted.
    """
    path = os.environ.get("PYTHONPATH", "")
    environment = os.environ | {"PYTHONPATH": f"{_ROOT}{os.pathsep}{path}" if path else str(_ROOT)}
    if "/" in channel:
        channel = str(Path(channel).absolute())
    started = subprocess.Popen(
        [sys.executable, "-m", "rrins.host_tools.bus.hub", "--", channel],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        text=True,
    )
    with started:
        assert started.stdout is not None
        said = []
        for line in started.stdout:  # the hub lets go of the pipe once it has something to say
            said.append(line.strip())
            if said[-1] == READY:
                return ""
    return said[-1] if said else "it ended without a message"


def attach(channel: str, may_start: bool, timeout: float, **wishes: Any) -> Link:
    """Attach to a channel and, if nobody hosts it, start a hub that does.

    Parameters
    ----------
    channel : str
        Name or path of the channel.
    may_start : bool
        Whether a hub may be started.
    timeout : float
        Seconds that all of it may take.
    **wishes
        Further arguments of `Link`.

    Raises
    ------
    BusError
        If the channel cannot be attached to.
    """
    deadline = time.monotonic() + timeout
    while True:
        # Each pass ends in a link or in the start of a process, so this does not spin. A hub that
        # ends between its start and our call, or does not listen yet, is called once more.
        try:
            return Link(channel, timeout=timeout, **wishes)
        except NoHostError:
            if not may_start or time.monotonic() >= deadline:
                raise
        refusal = start_hub(channel)
        if refusal:
            raise BusError(f"cannot start a host for channel {channel!r}: {refusal}")
