"""Takes a routine's order to the modes: part of the compiled step."""

from __future__ import annotations

from typing import Any

from numba import njit

from firmware_py import modes
from firmware_py.diagnostics.records import Order
from firmware_py.modes import Mode, ModeRequest

_STANDBY, _SELF_TEST, _ALIGN = int(Order.STANDBY), int(Order.SELF_TEST), int(Order.ALIGN)
_START, _STOP = int(Order.START_ROTATION), int(Order.STOP_ROTATION)


@njit(cache=True)
def _go(state: Any, mode: int, pending: int, request: int) -> None:
    """Go to a mode, as if the operator had asked for it: whoever asks next is obeyed."""
    state.modes.requested = request
    state.modes.request = request
    state.modes.pending = pending
    modes.enter(state, mode)


@njit(cache=True)
def take(state: Any) -> None:
    """Act on an order as far as the present mode allows; it may have changed since it was given."""
    order = state.diagnostics.order
    state.diagnostics.order = 0
    mode = state.modes.mode
    if order == _SELF_TEST and mode in (Mode.STANDBY, Mode.FAULT):
        _go(state, Mode.SELF_TEST, Mode.STANDBY, ModeRequest.STANDBY)
    elif order == _ALIGN and mode == Mode.STANDBY:
        _go(state, Mode.ALIGNMENT, Mode.ALIGNMENT, ModeRequest.ALIGN)
    elif order == _STANDBY and (mode == Mode.ALIGNMENT or modes.navigating(state)):
        _go(state, Mode.STANDBY, Mode.STANDBY, ModeRequest.STANDBY)
    elif order == _START and mode == Mode.NAVIGATION_STRAPDOWN:
        rotating = Mode.NAVIGATION_ROTATING
        _go(state, rotating, rotating, ModeRequest.NAVIGATE_ROTATING)
    elif order == _STOP and mode == Mode.NAVIGATION_ROTATING:
        strapdown = Mode.NAVIGATION_STRAPDOWN
        _go(state, strapdown, strapdown, ModeRequest.NAVIGATE_STRAPDOWN)
