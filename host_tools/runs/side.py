"""One side alone, as `rrins firmware` and `rrins hardware` run it."""

from __future__ import annotations

import contextlib
from pathlib import Path

from rrins.host_tools.bridges import slcan
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.rehearsal import default_address
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.runs.sides.firmware_job import run_firmware
from rrins.host_tools.runs.sides.hardware_job import run_hardware
from rrins.host_tools.runs.sides.job import Job


def address_of(interface: str, channel: str | None, bitrate: int | None) -> Address:
    """Return the bus of a side alone: without a channel, both sides meet on ``rrins0``."""
    if channel is None and interface == "rrins":
        channel = "rrins0"
    return default_address(interface, channel, bitrate)


def check_line(side: Side, job: Job) -> None:
    """Warn of an slcan line that is too slow for real time.

    Raises
    ------
    BusError
        If the line has no usable baud rate.
    """
    warning = slcan.too_slow(job.address, job.scenario, side)
    if warning is not None and job.is_realtime:
        ReportPipe(job.report_fd).note(side, warning)


def run_side(side: Side, job: Job) -> JsonObject:
    """Run one side to its end; return its summary.

    Raises
    ------
    RehearsalError
        When the bus cannot be had or ends, or the other side is lost.
    """
    with contextlib.suppress(OSError):  # what ps and top show: 15 characters at most
        Path("/proc/self/comm").write_text(f"rrins {side}", encoding="ascii")
    run = {"firmware": run_firmware, "hardware": run_hardware}[side]
    return run(job)
