"""Limits that a serial line sets for a rehearsal over slcan (LAWICEL) adapters.

A data frame is sent as ``tIIILDD…`` and a carriage return; the adapter acknowledges each frame
with at most two characters.
"""

from __future__ import annotations

from dataclasses import dataclass

from rrins.dbc.codec import load
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.errors import BusError
from rrins.host_tools.scenario.scenario import Scenario

INTERFACE = "slcan"
"""python-can's name of the interface."""

DEFAULT_BAUD = 115200
"""python-can's default, unless the channel ends in ``@BAUD``."""

_BITS_A_BYTE = 10
_FRAME_BYTES = 6  # besides two for each byte of data: t, identifier, length, carriage return
_ACKNOWLEDGEMENT_BYTES = 2
_USB = "/dev/ttyACM"  # USB CDC: the baud rate has no effect


@dataclass(frozen=True)
class LineLoad:
    """Load of a side's serial line.

    Attributes
    ----------
    to_adapter, from_adapter : int
        Bytes per second: frames sent, and frames received with acknowledgements.
    """

    to_adapter: int
    from_adapter: int

    @property
    def baud(self) -> int:
        """Lowest baud rate that carries both directions at once."""
        return max(self.to_adapter, self.from_adapter) * _BITS_A_BYTE


def line_load(scenario: Scenario, side: Side) -> LineLoad:
    """Return the mean load of a side's serial line in a rehearsal of a scenario."""
    own, own_frames = _sent_by(scenario, side)
    others, _ = _sent_by(scenario, "hardware" if side == "firmware" else "firmware")
    return LineLoad(round(own), round(others + own_frames * _ACKNOWLEDGEMENT_BYTES))


def _is_estimated(scenario: Scenario, what: str) -> bool:
    """Return whether the firmware sends what the estimator knows of something."""
    fitted = {
        "ODOMETER": scenario.odometer is not None,
        "MOUNTING": scenario.odometer is not None,
        "ALTIMETER": scenario.altimeter is not None,
        "CONSTANT": scenario.estimates_constants,
    }
    return scenario.estimator.enabled and fitted.get(what, True)


def _sent_by(scenario: Scenario, side: Side) -> tuple[float, float]:
    """Return the bytes and frames per second that a side sends."""
    groups = max(len(scenario.rimu.gyros), len(scenario.rimu.accelerometers))
    total_bytes = total_frames = 0.0
    database = load().database
    sync_ms = database.get_message_by_name("SYNC").cycle_time  # the cycle that means every epoch
    for message in database.messages:
        is_hardware = bool({"HARDWARE", "HOST"} & set(message.senders))
        if is_hardware != (side == "hardware") or not message.senders:
            continue
        stem, _, number = message.name.rpartition("_")
        if stem == "SENSOR" and int(number) > groups:
            continue
        if "FAULT_" in message.name and message.name != "FIRMWARE_FAULTS":
            continue  # only while there are faults
        if message.name == "ALTIMETER" and scenario.altimeter is None:
            continue
        if stem == "ESTIMATOR" and not _is_estimated(scenario, number):
            continue
        if message.name == "ZERO_VELOCITY" and not scenario.zero_velocity:
            continue
        aiding = (scenario.gnss, scenario.odometer, *scenario.zero_velocity)
        if message.name == "AIDING_STATUS" and not any(aiding):
            continue
        cycle_ms = message.cycle_time or 0
        if stem == "GNSS":
            if scenario.gnss is None:
                continue
            cycle_ms = 1000 // scenario.gnss.rate_hz
        if stem == "MASTER":
            if scenario.firmware.initial_attitude != "transferred":
                continue
            cycle_ms = 1000 // (1 if scenario.master is None else scenario.master.rate_hz)
        if message.name == "ODOMETER":
            if scenario.odometer is None:
                continue
            cycle_ms = 1000 // scenario.odometer.rate_hz
        per_s = scenario.rate_hz if cycle_ms == sync_ms else 1000.0 / cycle_ms if cycle_ms else 0.0
        total_bytes += per_s * (_FRAME_BYTES + 2 * message.length)
        total_frames += per_s
    return total_bytes, total_frames


def baud_of(channel: str) -> int | None:
    """Return the baud rate of a channel; None if it has none.

    Raises
    ------
    BusError
        If the text after its ``@`` is not a baud rate.
    """
    device, at, baud = channel.partition("@")
    if at and not (baud.isascii() and baud.isdecimal() and int(baud)):
        raise BusError(f"bus {INTERFACE}:{channel}: {baud!r} is not a baud rate; use {device}@BAUD")
    if device.startswith(_USB):
        return None
    return int(baud) if at else DEFAULT_BAUD


def too_slow(address: Address, scenario: Scenario, side: Side) -> str | None:
    """Return a warning if the serial line is too slow for real time; None otherwise.

    Raises
    ------
    BusError
        If the text after the ``@`` of its channel is not a baud rate.
    """
    if address.interface != INTERFACE:
        return None
    baud, needed = baud_of(address.channel), line_load(scenario, side).baud
    if baud is None or baud >= needed:
        return None
    device = address.channel.partition("@")[0]
    return (
        f"bus {address}: {scenario.rate_hz} Hz needs {needed} baud, the line has {baud}; frames "
        f"will be late. Use a faster line, {device}@BAUD, or lower rate_hz"
    )


def refuse_one_for_two(address: Address) -> None:
    """Refuse a rehearsal over one slcan adapter.

    Raises
    ------
    BusError
        Always on slcan: both sides would read the same serial line.
    """
    if address.interface == INTERFACE:
        raise BusError(
            f"bus {address}: each side needs its own adapter; start `rrins hardware` on one and "
            "`rrins firmware` on the other"
        )
