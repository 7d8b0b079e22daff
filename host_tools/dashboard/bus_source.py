"""A bus that somebody else runs, watched; and a rehearsal that the dashboard starts itself."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from rrins.host_tools.bus.address import Address
from rrins.host_tools.dashboard.bus_control import BusControl
from rrins.host_tools.dashboard.child import ChildRehearsal, Start
from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.page_orders import OF_BUS, OF_REHEARSAL, Order
from rrins.host_tools.dashboard.source import described
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.errors import BusError, RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.receiver import Receiver
from rrins.host_tools.monitor.vitals import STATUS
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.runs.sides.steering import PAUSED, UNLIMITED, Helm
from rrins.host_tools.scenario.scenario import Scenario

NAME: Final = "dashboard"
"""Name of the observer on the embedded bus."""

_REST_S: Final = 0.012  # between two reads
_AGAIN_S: Final = 1.0  # between attempts to attach
_CONFIRM_S: Final = 5.0
_LOOK_S: Final = 0.05
_STILL_S: Final = 0.3  # without a frame: it stands still


class BusSource:
    """A bus, watched; after its end the next one on the same channel.

    Parameters
    ----------
    address : Address
    scenario : Scenario or None
        What runs there, if it is known.
    may_control : bool
        Whether orders may go onto the bus.

    Raises
    ------
    BusError
        When there is no such bus.
    """

    kind = "bus"

    def __init__(self, address: Address, scenario: Scenario | None, may_control: bool) -> None:
        self.address = address
        self.orders = OF_BUS if may_control else frozenset()
        self._scenario = scenario
        self._stop = threading.Event()
        self._receiver: Receiver | None = None
        self._view = self._attach()
        self._keeper = threading.Thread(target=self._keep, name="dashboard", daemon=True)
        self._keeper.start()

    @property
    def view(self) -> View:
        """The view."""
        return self._view

    def turn(self) -> None:
        """Do nothing: the keeper does."""

    def _attach(self) -> View:
        watch = Watch(self.address.bitrate, is_wall_time=not self.address.is_embedded)
        self._receiver = Receiver(self.address, watch, NAME, _REST_S)
        return View(watch, self._scenario)

    def _keep(self) -> None:
        """Attach to the next bus on the channel, whenever one has ended."""
        while not self._stop.wait(_AGAIN_S):
            if not self._view.watch.has_ended:
                continue
            try:
                self._detach()
                self._view = self._attach()
            except RehearsalError:
                continue  # not there yet

    def _detach(self) -> None:
        if self._receiver is not None:
            self._receiver.close()
            self._receiver = None

    def describe(self) -> JsonObject:
        """Return what a browser needs to know once for each view."""
        return {"bus": str(self.address), "scenario": described(self._scenario)}

    def status(self) -> JsonObject:
        """Return how it is."""
        if self._view.watch.has_ended:
            return {"phase": "ended", "words": f"the bus has ended; waiting on {self.address}"}
        return {"phase": "running", "words": ""}

    def carry_out(self, order: Order) -> JsonObject:
        """Carry out an order on the bus."""
        return BusControl(self.address, self._mode).carry_out(order)

    def _mode(self) -> str | None:
        return self._view.watch.state().text(STATUS, "mode")

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._keeper.join()
        self._detach()


class RehearsalSource(BusSource):
    """A rehearsal that the dashboard starts, steers and stops.

    Parameters
    ----------
    start : Start
        What is rehearsed, and how.
    speed : float
        Factor of real time at first; `UNLIMITED` for as fast as it goes.
    """

    kind = "rehearsal"

    def __init__(self, start: Start, speed: float) -> None:
        self._start = start
        self._speed = speed
        self._folder = tempfile.TemporaryDirectory(prefix="rrins-dashboard-")
        self._helm = Helm(Path(self._folder.name) / "speed")
        self._child: ChildRehearsal | None = None
        self._words = "starting"
        self._phase = "starting"
        self._wanted = threading.Event()  # a rehearsal
        self._wanted.set()
        super().__init__(start.address, start.scenario, may_control=True)
        self.orders = OF_REHEARSAL

    def _attach(self) -> View:
        return View(Watch(), self._scenario)  # empty until the bus is there

    def _keep(self) -> None:
        """Run one rehearsal after the other; each starts on an order, the first at once."""
        while not self._stop.is_set():
            if not self._wanted.wait(_LOOK_S):
                continue
            self._wanted.clear()
            try:
                self._run()
            except RehearsalError as error:
                self._set("failed", str(error))

    def _set(self, phase: str, words: str) -> None:
        self._phase, self._words = phase, words

    def _run(self) -> None:
        self._set("starting", "starting")
        self._helm.steer(PAUSED)
        with ChildRehearsal(self._start, self._helm_path) as child:
            self._child = child
            try:
                if self._await_bus(child):
                    self._set("running", "")
                    self._helm.steer(self._speed)
                    while child.is_running and not self._stop.wait(_LOOK_S):
                        pass
            finally:
                child.stop()
                self._child = None
                self._detach()
        self._set(*child.outcome())
        self._view.log.add(self._view.time_s, self._words, "note")

    @property
    def _helm_path(self) -> Path:
        return Path(self._folder.name) / "speed"

    def _await_bus(self, child: ChildRehearsal) -> bool:
        """Attach once the hardware hosts the bus; return False if it ends before."""
        while child.is_running and not self._stop.is_set():
            self._set("starting", child.latest or "starting")
            watch = Watch()
            try:
                self._receiver = Receiver(self.address, watch, NAME, _REST_S)
            except BusError:
                self._stop.wait(_LOOK_S)
                continue
            view = View(watch, self._scenario)
            view.look()  # its history begins with the run, however late somebody looks again
            self._view = view
            return True
        return False

    def describe(self) -> JsonObject:
        """Return what a browser needs to know once for each view."""
        return super().describe() | {"name": self._start.name}

    def status(self) -> JsonObject:
        """Return how it is."""
        speed = self._helm.speed
        phase, words = self._phase, self._words
        if phase == "running" and speed == PAUSED:
            phase, words = "paused", "paused"
        wanted = 0.0 if self._speed == UNLIMITED else self._speed
        return {"phase": phase, "words": words, "wanted_speed": wanted}

    def carry_out(self, order: Order) -> JsonObject:
        """Carry out an order: to the rehearsal itself, or on its bus."""
        if order.order == "start":
            return {"text": self._begin()}
        if self._phase != "running":
            raise DashboardError(f"{order.order}: no rehearsal is running")
        if order.order == "stop":
            return {"text": self._end()}
        if order.order == "pause":
            return {"text": "paused", "at_s": self._pause()}
        if order.order == "speed":
            return {"text": self._go(order.speed or UNLIMITED)}
        if self._helm.speed == PAUSED:
            raise DashboardError(f"{order.order}: the rehearsal is paused; nobody could answer")
        return super().carry_out(order)

    def _begin(self) -> str:
        if self._phase in ("running", "starting"):
            raise DashboardError("start: a rehearsal is running already")
        self._set("starting", "starting")
        self._wanted.set()
        self._confirm(lambda: self._phase not in ("starting",), "start", 300.0)
        if self._phase != "running":
            raise DashboardError(f"start: {self._words}")
        return "the rehearsal has started"

    def _end(self) -> str:
        child = self._child
        if child is not None:
            self._helm.steer(UNLIMITED if self._helm.speed == PAUSED else self._helm.speed)
            child.stop()
        self._confirm(lambda: self._phase != "running", "stop", 60.0)
        return self._words

    def _pause(self) -> float:
        self._helm.steer(PAUSED)
        watch = self._view.watch
        self._confirm(lambda: watch.state().times.quiet_s > _STILL_S, "pause")
        return watch.state().time_s

    def _go(self, speed: float) -> str:
        begun_s = self._view.watch.state().time_s
        self._speed = speed
        self._helm.steer(speed)
        self._confirm(lambda: self._view.watch.state().time_s > begun_s, "speed")
        return "as fast as it goes" if speed == UNLIMITED else f"running at {speed:g} × real time"

    def _confirm(
        self, is_so: Callable[[], bool], what: str, patience_s: float = _CONFIRM_S
    ) -> None:
        until = time.monotonic() + patience_s
        while not is_so():
            if time.monotonic() > until:
                raise DashboardError(f"{what}: not confirmed within {patience_s:g} s")
            time.sleep(_LOOK_S)

    def close(self) -> None:
        """Stop the rehearsal and clear up."""
        super().close()
        self._helm.close()
        self._folder.cleanup()
