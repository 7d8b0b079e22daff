"""Passes routine requests to the mode logic: part of the compiled step."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.diagnostic_records import RoutineRequest
from rrins.firmware_py.core.records.memory import Ram

_STANDBY, _SELF_TEST = int(RoutineRequest.STANDBY), int(RoutineRequest.SELF_TEST)
_ALIGN = int(RoutineRequest.ALIGN)
_START, _STOP = int(RoutineRequest.START_ROTATION), int(RoutineRequest.STOP_ROTATION)


@compiled
def _go(state: Ram, mode: int, pending: int, request: int) -> None:
    """Enter a mode as if the operator had requested it; any later request overrides it."""
    state.modes.requested = request
    state.modes.request = request
    state.modes.pending = pending
    modes.enter(state, mode)


@compiled
def follow(state: Ram) -> None:
    """Handle a routine's request if the mode, which may have changed meanwhile, allows it."""
    asked = state.diagnostics.routine_request
    state.diagnostics.routine_request = 0
    mode = state.modes.mode
    if asked == _SELF_TEST and mode in (Mode.STANDBY, Mode.FAULT):
        _go(state, Mode.SELF_TEST, Mode.STANDBY, ModeRequest.STANDBY)
    elif asked == _ALIGN and mode == Mode.STANDBY:
        _go(state, Mode.ALIGNMENT, Mode.ALIGNMENT, ModeRequest.ALIGN)
    elif asked == _STANDBY and (mode == Mode.ALIGNMENT or modes.is_inertial(state)):
        _go(state, Mode.STANDBY, Mode.STANDBY, ModeRequest.STANDBY)
    elif asked == _START and mode == Mode.NAVIGATION_STRAPDOWN:
        rotating = Mode.NAVIGATION_ROTATING
        _go(state, rotating, rotating, ModeRequest.NAVIGATE_ROTATING)
    elif asked == _STOP and mode == Mode.NAVIGATION_ROTATING:
        strapdown = Mode.NAVIGATION_STRAPDOWN
        _go(state, strapdown, strapdown, ModeRequest.NAVIGATE_STRAPDOWN)
