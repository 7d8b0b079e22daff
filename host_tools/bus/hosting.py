"""Host of a channel: its powers besides taking part."""

from __future__ import annotations

from collections.abc import Iterable

import can

from rrins.host_tools.bus.end import BusTimeoutError
from rrins.host_tools.bus.guard import BusSummary
from rrins.host_tools.bus.hub import Hub
from rrins.host_tools.bus.peer import PeerInfo
from rrins.host_tools.errors import BusError


class Hosting:
    """The part of a bus object that is for a host only: its peers, and what it lets through."""

    channel: str
    host_pid: int
    _hub: Hub | None
    _is_lost: bool

    def _translated(self, error: BusError) -> can.CanError:
        """Return python-can's exception for an error; the bus has ended but after a timeout."""
        if isinstance(error, BusTimeoutError):
            return can.CanTimeoutError(str(error))
        self._is_lost = True
        return can.CanOperationError(str(error))

    @property
    def peers(self) -> tuple[PeerInfo, ...]:
        """Names, processes and roles of the attached peers; for a host only."""
        return self._hosted().peers

    def wait_for(self, name: str, timeout: float | None = None) -> PeerInfo:
        """Serve the channel until a peer of that name is attached; for a host only.

        What arrives meanwhile is received afterwards.

        Raises
        ------
        can.CanTimeoutError
            If no peer of that name has attached within `timeout` seconds.
        """
        try:
            return self._hosted().wait_for(name, timeout)
        except BusError as error:
            raise self._translated(error) from error

    def statistics(self) -> BusSummary:
        """Return what the host did not let through, and from whom; for a host only."""
        return self._hosted().statistics()

    def limit_others(self) -> None:
        """Hold third parties to their share of frames before the first epoch, too; for a host."""
        self._hosted().limit_others()

    def require(self, names: Iterable[str]) -> None:
        """Let sending and receiving fail once one of these peers has left; for a host only.

        Replaces what was required before, and forgives what was lost.

        Raises
        ------
        can.CanOperationError
            If one of them is not attached now; later it names the one that has left.
        """
        try:
            self._hosted().require(names)
        except BusError as error:
            raise can.CanOperationError(str(error)) from error
        self._is_lost = False

    def _hosted(self) -> Hub:
        if self._hub is None:
            raise can.CanOperationError(
                f"only the host of channel {self.channel!r} sees its peers: process {self.host_pid}"
            )
        return self._hub

    def rest(self, seconds: float) -> None:
        """Serve the channel for some time; what arrives meanwhile is received afterwards.

        Raises
        ------
        can.CanOperationError
            If the bus has come to its end for this node.
        """
        try:
            self._hosted().rest(seconds)
        except BusError as error:
            raise self._translated(error) from error
