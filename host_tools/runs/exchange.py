"""An epoch exchange: the hardware opens an epoch, the firmware steps, its frames go back."""

from __future__ import annotations

from rrins.dbc.frame import FrameArray
from rrins.firmware_py.core.clock import own_clock_ns
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware


def exchange_epoch(
    hardware: Hardware, firmware: Firmware, epoch: int, count: int, clock_error_ppm: float = 0.0
) -> int:
    """Run an epoch of both sides in one process.

    Parameters
    ----------
    hardware : Hardware
    firmware : Firmware
        Its `outbox` has the frames that the hardware gets.
    epoch : int
    count : int
        How many these are: what the exchange before returned; 0 in the first epoch.
    clock_error_ppm : float
        By how much the firmware's clock runs fast.

    Returns
    -------
    int
        Frames in the firmware's `outbox` now, for the next exchange.
    """
    frames, sent = hardware.open_epoch(epoch, firmware.outbox, count)
    count = answer_epoch(firmware, frames, sent, epoch, clock_error_ppm)
    hardware.frames_received += count
    return count


def answer_epoch(
    firmware: Firmware, frames: FrameArray, count: int, epoch: int, clock_error_ppm: float = 0.0
) -> int:
    """Let the firmware step on the frames of an epoch that is open; the half of an exchange.

    Returns how many frames its `outbox` has now.
    """
    arrival_ns = own_clock_ns(epoch * firmware.period_ns, clock_error_ppm)
    return firmware.step_whole(frames, count, arrival_ns)
