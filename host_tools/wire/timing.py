"""Model of the wire: a CAN bus in virtual time, bit by bit.

`WireModel` takes frames from nodes at a time and says which frames had ended by a later one: with
arbitration, bit stuffing, acknowledgement, error frames, retransmission and fault confinement. It
has no clock, and the same calls give the same bits. What is modelled is told in
`rrins.host_tools.wire.bits` (lengths), `rrins.host_tools.wire.confinement` (error counters) and
`rrins.host_tools.wire.arbitration` (who sends, and errors). What is not: bit timing, sampling and
propagation (a node that becomes ready within the SOF bit of another one waits), overload frames,
CAN FD, errors that only some of the receivers see.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from rrins.dbc.frame import FrameArray
from rrins.host_tools.wire import load, state, transmission
from rrins.host_tools.wire.confinement import NodeState, state_of
from rrins.host_tools.wire.state import ANY

_NS_PER_S = 1_000_000_000
_SLOWEST, _FASTEST = 10_000, 1_000_000
_OUT_CAPACITY = 4096


class NodeStatistics(TypedDict):
    """Statistics of a node; the counts are those of `state.WireNode`."""

    state: str
    tec: int
    rec: int
    waiting: int
    submitted: int
    sent: int
    errors: int
    retransmissions: int
    busy_ns: int
    overflowed: int
    discarded: int
    abandoned: int
    invalid: int
    bus_offs: int
    most_waiting: int


class IdentifierStatistics(TypedDict):
    """Statistics of the frames of an identifier; see `state.IdentifierCounts`."""

    sent: int
    errors: int
    retransmissions: int
    busy_ns: int
    worst_delay_ns: int
    worst_response_ns: int


class Statistics(TypedDict):
    """Statistics of a wire; see `WireModel.statistics`."""

    elapsed_ns: int
    busy_ns: int
    load: float
    window_load: float
    worst_window_load: float
    nodes: dict[str, NodeStatistics]
    identifiers: dict[int, IdentifierStatistics]
    extended: IdentifierStatistics


def bit_time_ns(bitrate: int) -> int:
    """Return the length of a bit in ns; raise `ValueError` for a rate that no wire has.

    `bitrate` is in bit/s, from 10 000 to 1 000 000, and its bit must be a whole number of ns.
    """
    if not _SLOWEST <= bitrate <= _FASTEST or _NS_PER_S % bitrate:
        raise ValueError(
            f"bit rate {bitrate}: must be {_SLOWEST} to {_FASTEST} bit/s "
            "with a bit of a whole number of ns"
        )
    return _NS_PER_S // bitrate


class WireModel:
    """A wire and the nodes on it; all times are integer ns of one virtual time.

    Parameters
    ----------
    bitrate : int
        In bit/s, see `bit_time_ns`.
    nodes : sequence of str
        Names of the nodes, at most `wire.state.NODES`; elsewhere a node is its index.
    start_ns : int
        When the wire begins, idle.
    retransmission : bool
        Whether a frame that an error frame ended is sent again; otherwise it is lost.
    recovery : bool
        Whether a node that is off the bus comes back.
    window_ns : int
        Length of the windows over which the load is told, counted from `start_ns`.

    Attributes
    ----------
    mediums : Records[WireState]
        One record: the whole state of the model.
    now_ns : int
        The time up to which the wire has run.

    Notes
    -----
    `silence`, `cut` and `fail_next` take effect at the next transmission; the one on the wire
    continues.
    """

    def __init__(
        self,
        bitrate: int,
        nodes: Sequence[str] = ("hardware", "firmware"),
        *,
        start_ns: int = 0,
        retransmission: bool = True,
        recovery: bool = True,
        window_ns: int = 100_000_000,
    ) -> None:
        if not 1 <= len(nodes) <= state.NODES or len(set(nodes)) < len(nodes):
            raise ValueError(f"nodes {tuple(nodes)}: must be 1 to {state.NODES} different names")
        if window_ns <= 0:
            raise ValueError(f"window of {window_ns} ns: must be longer than nothing")
        self.bitrate = bitrate
        self.nodes = tuple(nodes)
        self.now_ns = start_ns
        self.mediums = state.power_on(
            bit_time_ns(bitrate),
            len(nodes),
            start_ns=start_ns,
            retransmission=retransmission,
            recovery=recovery,
            window_ns=window_ns,
        )
        self._receivers = np.zeros(_OUT_CAPACITY, dtype=np.int64)

    def submit(self, node: int, frames: FrameArray, count: int, time_ns: int) -> int:
        """Submit the first `count` frames to a node for a time; return how many it accepted.

        A node has room for `state.NODE_CAPACITY` frames and sends the one with the
        strongest identifier first, equal ones in the order in which they came. Frames that find no
        room are lost, and so are those for a node that is silent or off the bus now; see the
        counters `overflowed` and `discarded` of `statistics`. A frame of SocketCAN that reports an
        error, or has more than eight bytes, is lost as `invalid`.
        """
        self._check_node(node)
        if time_ns < self.now_ns:
            raise ValueError(f"frames for {time_ns} ns: the wire has run to {self.now_ns} ns")
        if not 0 <= count <= len(frames):
            raise ValueError(f"{count} frames out of an array of {len(frames)}")
        return state.submit(self.mediums, node, frames, count, time_ns)

    def run(
        self,
        until_ns: int,
        out_frames: FrameArray,
        out_times_ns: NDArray[np.int64],
        out_nodes: NDArray[np.int64],
        out_receivers: NDArray[np.int64] | None = None,
    ) -> int:
        """Run the wire up to a time; return how many frames have ended since the run before.

        Parameters
        ----------
        until_ns : int
            Frames whose EOF ends at or before this time are given; transmissions begin before it,
            so that frames may still be submitted for this very time.
        out_frames : FrameArray
        out_times_ns, out_nodes : arrays of int64, as long as `out_frames`
            When each frame's EOF ended, and its node; the first one if several sent it together.
        out_receivers : array of int64 as long as `out_frames`, optional
            Bit k is set if node k received the frame.

        Returns
        -------
        int
            Frames written. If that is the length of the arrays, the wire may have stopped before
            `until_ns`, at `now_ns`, and the call is to be repeated.
        """
        if until_ns < self.now_ns:
            raise ValueError(f"run to {until_ns} ns: the wire has run to {self.now_ns} ns")
        capacity = len(out_frames)
        if out_receivers is None:
            if len(self._receivers) < capacity:
                self._receivers = np.zeros(capacity, dtype=np.int64)
            out_receivers = self._receivers
        if min(len(out_times_ns), len(out_nodes), len(out_receivers)) < capacity:
            raise ValueError("the arrays for times, nodes and receivers are shorter than frames'")
        count = int(
            transmission.advance(
                self.mediums, until_ns, out_frames, out_times_ns, out_nodes, out_receivers
            )
        )
        self.now_ns = until_ns if count < capacity else int(self.mediums[0].now_ns)
        return count

    def fail_next(self, identifier: int = ANY, node: int = ANY, times: int = 1) -> None:
        """Make the next matching transmissions end in an error frame, for a wrong CRC.

        `identifier` has `rrins.dbc.frame.EFF_FLAG` if it is extended; `ANY` matches all.
        """
        if node != ANY:
            self._check_node(node)
        if times < 1:
            raise ValueError(f"fail {times} times: must be once at least")
        for order in self.mediums[0].failure:
            if order.left == 0:
                order.left, order.identifier, order.node = times, identifier, node
                return
        raise ValueError(f"{state.FAILURES} orders to fail are open already")

    def has_order(self, node: int) -> bool:
        """Return whether an order of `fail_next` for a node is still open."""
        orders = self.mediums[0].failure
        return bool(np.any((orders["left"] > 0) & (orders["node"] == node)))

    def silence(self, node: int, on: bool) -> None:
        """Make a node listen only, or send again.

        A silent node sends no frames, no acknowledgement and no error flags, and its error
        counters rest. What waits in it is lost.
        """
        self._check_node(node)
        self.mediums[0].node[node].silent = on
        if on:
            state.discard_all(self.mediums[0], node)

    def cut(self, on: bool) -> None:
        """Cut the wire between all nodes, or repair it.

        While it is cut each node is alone: what it sends is never acknowledged, until it is
        error-passive and goes on trying. All try at the same time, and again when the longest
        attempt is over.
        """
        self.mediums[0].cut = on

    def state(self, node: int) -> NodeState:
        """Return the fault confinement state of a node."""
        self._check_node(node)
        return NodeState(state_of(self.mediums[0].fault[node]))

    def statistics(self) -> Statistics:
        """Return the statistics so far, as plain numbers.

        ``load`` is the part of the time in which the wire was busy, intermissions included;
        ``window_load`` that of the last window that is over and ``worst_window_load`` the largest.
        ``nodes`` is by name, ``identifiers`` by standard identifier, ``extended`` for all others
        together. Of an identifier ``worst_delay_ns`` is the longest time from submission to the
        start of the transmission that succeeded, ``worst_response_ns`` that to the end of its EOF.
        A frame that several nodes sent together counts for each of them.
        """
        record = self.mediums[0]
        load.roll_window(record, self.now_ns)
        elapsed_ns = self.now_ns - int(record.start_ns)
        busy_ns = int(record.busy_ns) - max(0, int(record.free_ns) - self.now_ns)
        window_ns = int(record.window_ns)
        rows = record.identifier
        used = np.flatnonzero((rows["sent"] + rows["errors"])[:-1])
        return {
            "elapsed_ns": elapsed_ns,
            "busy_ns": busy_ns,
            "load": busy_ns / elapsed_ns if elapsed_ns else 0.0,
            "window_load": int(record.last_window_busy_ns) / window_ns,
            "worst_window_load": int(record.worst_window_busy_ns) / window_ns,
            "nodes": {name: self._node_statistics(k) for k, name in enumerate(self.nodes)},
            "identifiers": {row: _plain(rows[row]) for row in used.tolist()},
            "extended": _plain(rows[state.STANDARD_IDENTIFIERS]),
        }

    def _node_statistics(self, node: int) -> NodeStatistics:
        record = self.mediums[0].node[node]
        fault = self.mediums[0].fault[node]
        return {
            "state": self.state(node).name.lower(),
            "tec": int(fault.tec),
            "rec": int(fault.rec),
            "waiting": int(record.count),
            "submitted": int(record.submitted),
            "sent": int(record.sent),
            "errors": int(record.errors),
            "retransmissions": int(record.retransmissions),
            "busy_ns": int(record.busy_ns),
            "overflowed": int(record.overflowed),
            "discarded": int(record.discarded),
            "abandoned": int(record.abandoned),
            "invalid": int(record.invalid),
            "bus_offs": int(record.bus_offs),
            "most_waiting": int(record.most_waiting),
        }

    def _check_node(self, node: int) -> None:
        if not 0 <= node < len(self.nodes):
            raise ValueError(f"node {node}: there are {len(self.nodes)}")


def _plain(row: state.IdentifierCounts) -> IdentifierStatistics:
    return {
        "sent": int(row.sent),
        "errors": int(row.errors),
        "retransmissions": int(row.retransmissions),
        "busy_ns": int(row.busy_ns),
        "worst_delay_ns": int(row.worst_delay_ns),
        "worst_response_ns": int(row.worst_response_ns),
    }
