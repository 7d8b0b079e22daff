"""The GNSS antenna away from the reference point: how far in n, and how fast it moves there.

A fix is of the antenna: ``p + C_b_n l`` and ``v + d/dt (C_b_n l)`` for the lever arm l in the body
frame. Groves (2nd ed., 2013), (14.110), (14.111).
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths.attitude import multiply_transposed, rotate
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.records.memory import ANTENNA_EPOCHS, Antenna, Ram

_SPAN_S = 0.02
"""To either side, over which the velocity is taken: the steps of coarse encoders average out."""


@compiled
def follow(state: Ram) -> None:
    """Note the lever arm in n at the end of this epoch, where the strapdown runs."""
    antenna = state.antenna
    if not antenna.present or not modes.is_inertial(state):
        return
    if antenna.last + 1 != state.epoch:
        antenna.first = state.epoch
    antenna.last = state.epoch
    multiply_transposed(antenna.C_b_n, state.ins.C_s_n, state.C_s_b)
    rotate(antenna.lever_n[state.epoch % ANTENNA_EPOCHS], antenna.C_b_n, antenna.lever_arm_b)


@compiled
def _oldest(antenna: Antenna) -> int:
    return max(int(antenna.first), int(antenna.last) - ANTENNA_EPOCHS + 1)


@compiled
def is_known(antenna: Antenna, epoch: int) -> bool:
    """Return whether it is known where the antenna was at the end of an epoch."""
    return bool(_oldest(antenna) <= epoch <= antenna.last)


@compiled
def velocity(antenna: Antenna, epoch: int, dt: float, out: Floats) -> None:
    """Write its velocity in n against the reference point, m/s, at the end of a known epoch.

    The mean over some epochs around; without any after it, of the epoch itself.
    """
    back, ahead = epoch - _oldest(antenna), int(antenna.last) - epoch
    span = min(back, ahead, max(1, int(_SPAN_S / dt)))
    start, end = epoch - span, epoch + span
    if span == 0:
        start, end = (epoch - 1, epoch) if back > 0 else (epoch, epoch + min(1, ahead))
    before, after = antenna.lever_n[start % ANTENNA_EPOCHS], antenna.lever_n[end % ANTENNA_EPOCHS]
    for i in range(3):
        out[i] = (after[i] - before[i]) / (max(1, end - start) * dt)
