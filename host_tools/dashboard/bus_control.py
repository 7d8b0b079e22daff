"""Orders that go onto a bus: faults, modes, trouble codes; each with an answer from there."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import can
import numpy as np

from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import frame_array
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.routines import Routine
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import message_of_frame, open_bus
from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.page_orders import Order
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.diag.trouble_table import REMEMBERED, TroubleReport
from rrins.host_tools.diag.values import to_json
from rrins.host_tools.errors import BusError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.injection.fault_report import FaultReport, fault_keys, fault_words
from rrins.host_tools.scenario.scenario import fault_of

_MOST_WITH_FRAMES: Final = 12  # codes whose freeze frames are read at once
_PARITY: Final = {
    "gyro_parity": ("gyros", "dph"),
    "accelerometer_parity": ("accelerometers", "ug"),
}
_ANSWER_S: Final = 5.0
_LOOK_S: Final = 0.05
_SEND_S: Final = 2.0
_COUNTERS: Final = (0, 5, 10)  # a frame with the counter of the operator's last is not used


def routine_named(name: str) -> Routine:
    """Return a routine of the navigation computer."""
    return next(one for one in table.ROUTINES if one.name == name)


class BusControl:
    """Carries out orders on a bus, one at a time.

    Parameters
    ----------
    address : Address
    mode : callable
        Returns the mode that the firmware reports, None while that is not known.
    """

    def __init__(self, address: Address, mode: Callable[[], str | None]) -> None:
        self._address = address
        self._mode = mode

    def carry_out(self, order: Order) -> JsonObject:
        """Carry out an order; return the answer.

        Raises
        ------
        RehearsalError
            When it is refused, or nobody answers.
        """
        if order.order in ("inject", "remove", "list_faults", "clear_faults"):
            return self._on_faults(order)
        if order.order == "mode":
            return {"text": self._ask_mode(order.mode or "")}
        with Tester(Target(*self._target())) as tester:
            if order.order == "clear_codes":
                tester.clear()
                return {"text": "the trouble codes are cleared", "codes": []}
            if order.order == "read_residuals":
                return _residuals(tester)
            return self._codes(tester)

    def _target(self) -> tuple[str, str, int | None]:
        return self._address.interface, self._address.channel, self._address.bitrate

    def _on_faults(self, order: Order) -> JsonObject:
        given = {key: value for key, value in (order.fault or {}).items() if value is not None}
        with FaultClient(self._address) as client:
            if order.order == "clear_faults":
                report = client.clear()
                text = "all faults are removed"
                return {"text": text, "at_s": report.seconds(report.epoch), **_faults(report)}
            if order.order == "list_faults":
                return {"text": "", **_faults(client.report())}
            fault = fault_of(given)
            if order.order == "remove":
                report = client.remove(fault)
                text, at_s = (
                    f"{fault_words(fault_keys(fault))} removed",
                    report.seconds(report.epoch),
                )
                return {"text": text, "at_s": at_s, **_faults(report)}
            active, report = client.inject(fault)
            at_s = report.seconds(active.first_epoch)
            return {"text": active.words, "at_s": at_s, **_faults(report)}

    def _ask_mode(self, wanted: str) -> str:
        if wanted == "navigate":
            return self._navigate()
        rotation = routine_named("rotation")
        with Tester(Target(*self._target()), is_securing=True) as tester:
            if wanted == "standby":
                tester.start(routine_named("standby"), {})
            elif wanted == "rotation":
                tester.start(rotation, {})
            else:
                tester.stop(rotation)
        return f"{wanted}: accepted by the navigation computer"

    def _navigate(self) -> str:
        """Have the firmware act on the operator's request again: another one comes in between."""
        before = self._mode()
        if before != "STANDBY":
            raise DashboardError(f"navigate: goes from STANDBY only; the mode is {before}")
        for counter in _COUNTERS:
            self._send(_no_request(counter))
            until = time.monotonic() + _ANSWER_S / len(_COUNTERS)
            while time.monotonic() < until:
                mode = self._mode()
                if mode != before:
                    return f"the mode is {mode}"
                time.sleep(_LOOK_S)
        raise DashboardError(f"navigate: no change of mode within {_ANSWER_S:g} s")

    def _send(self, message: can.Message) -> None:
        options = {"host": "never", "name": "dashboard", "role": "observer"}
        bus = open_bus(self._address, **(options if self._address.is_embedded else {}))
        try:
            bus.send(message, timeout=_SEND_S)
        except can.CanError as error:
            raise BusError(f"bus {self._address}: {error}") from error
        finally:
            bus.shutdown()

    def _codes(self, tester: Tester) -> JsonObject:
        found = tester.troubles(REMEMBERED)
        codes = [
            _code(tester, one, with_frames=k < _MOST_WITH_FRAMES) for k, one in enumerate(found)
        ]
        count = len(codes)
        text = f"{count} trouble code{'' if count == 1 else 's'}" if count else "no trouble codes"
        return {"text": text, "codes": codes}


def _residuals(tester: Tester) -> JsonObject:
    """Return the parity residual of each sensor with its threshold: means of the last second."""
    read = tester.read([table.identifier(name) for name in _PARITY])
    found = {}
    for name, (kind, unit) in _PARITY.items():
        values = to_json(table.identifier(name).layout, read[name])
        pairs = zip(
            values[f"parity_residual_{unit}"], values[f"parity_threshold_{unit}"], strict=True
        )
        found[kind] = list(pairs)
    return {"text": "residuals of the last second", "residuals": found}


def _no_request(counter: int) -> can.Message:
    """Return a MODE_COMMAND that asks for nothing."""
    message = load_contract()[0]["mode_command"]
    frames = frame_array(1)
    fill(frames[0], message.message, np.uint64(0), counter)
    return message_of_frame(frames[0])


def _faults(report: FaultReport) -> JsonObject:
    return {
        "faults": [
            {"words": fault.words, "at_s": report.seconds(fault.first_epoch), "keys": fault.keys}
            for fault in report.faults
        ]
    }


def _code(tester: Tester, found: TroubleReport, with_frames: bool) -> JsonObject:
    trouble = found.trouble
    return {
        "code": found.code,
        "name": trouble.name if trouble else "not in this table",
        "text": trouble.text if trouble else "",
        "is_failed": bool(found.status & Status.TEST_FAILED),
        "status": found.status_bits,
        "freeze_frames": tester.freeze_frames(found.number) if with_frames else {},
    }
