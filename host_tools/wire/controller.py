"""State changes of the firmware's CAN controller, as SocketCAN reports them: error frames.

An error frame is the controller's word to its own computer and is never on the wire. Where the wire
is a model, so is the controller.
"""

from __future__ import annotations

from rrins.dbc.frame import ERR_FLAG, FrameArray
from rrins.host_tools.wire.confinement import NodeState
from rrins.host_tools.wire.timing import WireModel

# linux/can/error.h
_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x004, 0x040, 0x100, 0x200
_RX_PASSIVE, _TX_PASSIVE, _ACTIVE = 0x10, 0x20, 0x40  # byte 1, with _CONTROLLER
_PASSIVE_ABOVE = 127
_BYTE = 8


class ControllerWatch:
    """Tracks one node's fault confinement.

    Parameters
    ----------
    model : WireModel
    node : int
    """

    def __init__(self, model: WireModel, node: int) -> None:
        self._tec = model.mediums["fault"]["tec"][:, node]
        self._rec = model.mediums["fault"]["rec"][:, node]
        self._off = model.mediums["fault"]["bus_off"][:, node]
        self._bus_offs = model.mediums["node"]["bus_offs"][:, node]
        self._state = NodeState.ERROR_ACTIVE
        self._times_off = 0

    def tell(self, out: FrameArray) -> int:
        """Write an error frame to `out` for each change of the node's state; return the count."""
        tec, rec = int(self._tec[0]), int(self._rec[0])
        times_off = int(self._bus_offs[0])
        state = NodeState.ERROR_ACTIVE
        if self._off[0]:
            state = NodeState.BUS_OFF
        elif tec > _PASSIVE_ABOVE or rec > _PASSIVE_ABOVE:
            state = NodeState.ERROR_PASSIVE
        told: list[tuple[int, int]] = []
        if times_off != self._times_off:
            told.append((_BUS_OFF, 0))
            if state != NodeState.BUS_OFF:
                told.append((_RESTARTED, 0))
        elif state != self._state:
            told.append(self._change(state, tec))
        self._state, self._times_off = state, times_off
        for k, (error, detail) in enumerate(told):
            frame = out[k]
            frame["can_id"], frame["length"] = ERR_FLAG | error | _COUNTERS, 8
            counters = min(tec, 255) << (6 * _BYTE) | min(rec, 255) << (7 * _BYTE)
            frame["data"] = detail << _BYTE | counters
        return len(told)

    def _change(self, state: NodeState, tec: int) -> tuple[int, int]:
        """Return error class and byte 1 of a change without a time off the bus."""
        if state == NodeState.ERROR_PASSIVE:
            return _CONTROLLER, _TX_PASSIVE if tec > _PASSIVE_ABOVE else _RX_PASSIVE
        return (_RESTARTED, 0) if self._state == NodeState.BUS_OFF else (_CONTROLLER, _ACTIVE)
