"""Feeds the browsers: rows at 30 Hz, the state of the bus at 4 Hz, events and answers at once."""

from __future__ import annotations

import asyncio
import json
import logging
import math
from collections.abc import Sequence
from typing import Any, Final

from rrins.dbc.codec import load
from rrins.host_tools.dashboard.browsers import Browser
from rrins.host_tools.dashboard.bus_table import message_of
from rrins.host_tools.dashboard.events import Event
from rrins.host_tools.dashboard.explaining import Explainer
from rrins.host_tools.dashboard.fault_forms import fault_forms
from rrins.host_tools.dashboard.guides import guide_names
from rrins.host_tools.dashboard.packing import packed_history, packed_row
from rrins.host_tools.dashboard.page_orders import READING, Order
from rrins.host_tools.dashboard.quantities import NAMES
from rrins.host_tools.dashboard.source import Source
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject

ROW_HZ: Final = 30
STATE_EVERY: Final = 8  # rows: 3.75 Hz
_BUSY_HZ: Final = 10  # without browsers, for the history alone

_log: Final = logging.getLogger("rrins.dashboard")


def as_json(kind: str, values: JsonObject) -> str:
    """Return a message of a kind; NaN and infinity become null."""
    told = {"kind": kind} | values
    try:
        return json.dumps(told, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(told), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value


class Feed:
    """Looks at a source and feeds all browsers.

    Parameters
    ----------
    source : Source
    may_control : bool
        Whether any browser may give orders.
    tour : sequence of dict
        Steps of the tour that the page gives (`rrins.host_tools.dashboard.tour`).
    """

    def __init__(self, source: Source, may_control: bool, tour: Sequence[JsonObject] = ()) -> None:
        self.source = source
        self.may_control = may_control
        self._tour = list(tour)
        self._browsers: set[Browser] = set()
        self._sequence = 0
        self._turns = 0
        self._told = self._late = 0  # events
        self._viewed: View | None = None
        self._status = ""
        self._ordering = asyncio.Lock()
        self._explainer = Explainer()

    # ---- browsers

    def enter(self, browser: Browser) -> None:
        """Take a browser in: it gets all there is so far, then what comes."""
        self._browsers.add(browser)
        self._introduce(browser)

    def leave(self, browser: Browser) -> None:
        """Let a browser go."""
        self._browsers.discard(browser)

    @property
    def browsers(self) -> int:
        """How many look on."""
        return len(self._browsers)

    def _introduce(self, browser: Browser) -> None:
        view = self.source.view
        browser.begin_anew()
        browser.put(as_json("hello", self._hello(browser)))
        browser.put(packed_history(*view.history.rows()))
        browser.put(self._events(view.log.events, anew=True))
        browser.put_latest("status", as_json("status", self.source.status()))

    def _hello(self, browser: Browser) -> JsonObject:
        view = self.source.view
        may_control = self.may_control and browser.may_control
        messages = sorted(load().database.messages, key=lambda message: message.frame_id)
        return {
            "source": self.source.kind,
            "columns": list(NAMES),
            "may_control": may_control,
            "explains": may_control and view.scenario is not None,
            "orders": sorted(self.source.orders) if may_control else [],
            "forms": fault_forms() if may_control and "inject" in self.source.orders else {},
            "guides": sorted(guide_names()),
            "message_names": [message.name for message in messages],
            "tour": self._tour,
            **self.source.describe(),
        }

    @staticmethod
    def _events(events: list[Event], anew: bool = False) -> str:
        told = [[event.time_s, event.text, event.weight] for event in events]
        return as_json("events", {"events": told, "anew": anew})

    # ---- the loop

    async def run(self) -> None:
        """Look and feed until cancelled."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + 1 / (ROW_HZ if self._browsers else _BUSY_HZ), loop.time())
            self.turn()
            await asyncio.sleep(due - loop.time())

    def turn(self) -> None:
        """Look once, and feed."""
        self.source.turn()
        view = self.source.view
        if view is not self._viewed:
            self._begin(view)
        if view.look():
            self._sequence += 1
            row = packed_row(self._sequence, view.time_s, view.row)
            for browser in self._browsers:
                browser.put_row(row)
        self._tell_events(view)
        self._turns += 1
        if self._turns % STATE_EVERY == 0:
            self._tell_state(view)

    def _begin(self, view: View) -> None:
        """Begin with another view: all browsers begin anew."""
        self._viewed = view
        self._told, self._late = view.log.count, view.log.late
        for browser in self._browsers:
            self._introduce(browser)

    def _tell_events(self, view: View) -> None:
        new, late = view.log.count - self._told, view.log.late - self._late
        self._told, self._late = view.log.count, view.log.late
        if late > 0:
            self._tell_all(self._events(view.log.events, anew=True))
        elif new > 0:
            self._tell_all(self._events(view.log.events[-new:]))

    def _tell_all(self, message: str) -> None:
        for browser in self._browsers:
            browser.put(message)

    def _tell_state(self, view: View) -> None:
        state = view.state(any(browser.shown[0] for browser in self._browsers))
        if not self._browsers:
            return
        self._tell_status()
        told = as_json("state", view.told(state))
        for browser in self._browsers:
            browser.put_latest("state", told)
            name, signal, level = browser.shown
            if name is not None:
                found = message_of(state, name, signal, level, view.dialogue.measured)
                if found is not None:
                    browser.put_latest("message", as_json("message", found))

    def _tell_status(self) -> None:
        """Tell how the source is, once it has changed."""
        status = as_json("status", self.source.status())
        if status != self._status:
            self._status = status
            for browser in self._browsers:
                browser.put_latest("status", status)

    # ---- orders

    async def carry_out(self, browser: Browser, order: Order) -> None:
        """Carry out an order of a browser, and answer it."""
        if order.order == "show":
            self._show(browser, order)
            return
        if not (self.may_control and browser.may_control):
            _log.warning("order %s refused: this page may only look on", order.order)
            self._answer(browser, order, False, "this page may only look on")
            return
        if order.order == "explain":
            await self._explain(browser, order)
            return
        if order.order not in self.source.orders:
            self._answer(browser, order, False, f"{order.order}: not for this source")
            return
        asked_s = self.source.view.time_s
        try:
            async with self._ordering:  # orders on a bus may wait for answers
                answer = await asyncio.to_thread(self.source.carry_out, order)
        except RehearsalError as error:
            self._answer(browser, order, False, str(error))
            return
        text, at_s = str(answer.pop("text")), answer.pop("at_s", None)
        self._answer(browser, order, True, text, at_s)
        self._explainer.note(answer.get("faults"), self.source.view)
        if answer:
            self._tell_all(as_json("report", answer))
        if self.source.kind != "recording" and text and order.order not in READING:
            view = self.source.view
            at_s = asked_s if at_s is None else max(at_s, asked_s)
            view.log.add(min(at_s, view.time_s), text, "order")

    async def _explain(self, browser: Browser, order: Order) -> None:
        """Say what the error at an instant consists of, and how far that has come meanwhile."""
        loop = asyncio.get_running_loop()

        def tell(done: int, of: int) -> None:
            told = as_json("explaining", {"done": done, "of": of})
            loop.call_soon_threadsafe(browser.put_latest, "explaining", told)

        assert order.time_s is not None
        try:
            found = await self._explainer.explain(self.source.view, order.time_s, tell)
        except RehearsalError as error:
            self._answer(browser, order, False, str(error))
            return
        browser.put(as_json("explanation", found))
        self._answer(browser, order, True, str(found["title"]))

    def _show(self, browser: Browser, order: Order) -> None:
        known = {message.name for message in load().database.messages}
        name = order.name if order.name in known else None
        browser.shown = (name, order.signal, order.level)

    @staticmethod
    def _answer(
        browser: Browser, order: Order, is_done: bool, text: str, at_s: float | None = None
    ) -> None:
        told = {"id": order.id, "order": order.order, "is_done": is_done, "text": text}
        browser.put(as_json("answer", told | {"at_s": at_s}))
