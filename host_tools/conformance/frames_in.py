"""Checks of what a navigation computer takes of the bus: protection, gaps, SYNC, other senders."""

from __future__ import annotations

import can

from rrins.host_tools.conformance.check import Subject, check
from rrins.host_tools.rounding import rounded
from rrins.host_tools.testing.bench import Bench

_SENSOR = "SENSOR_2"
_LIMIT_M = 1.0
_WRONG_DATA = 0x3FFFFF  # counts of an increment: a turn that would be seen at once
_UNKNOWN = 0x00F  # an identifier that the contract does not have, before all others


def _counter(bench: Bench, name: str) -> int:
    bench.advance(0.2)  # the next FIRMWARE_FAULTS
    return bench.fault_counters[name]


def _lost(bench: Bench, sensors: int) -> None:
    """Expect that a sensor is not used while its frames are wrong, and again afterwards."""
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"usable_sensors": sensors - 1})
    bench.expect_not("FIRMWARE_STATUS", within=0.5, where={"usable_sensors": sensors})
    bench.clear_faults()
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"usable_sensors": sensors})


def _still_navigates(bench: Bench) -> None:
    bench.advance(1)
    assert bench.mode == "NAVIGATION_ROTATING", f"navigation has ended: mode {bench.mode}"
    east, north = bench.errors_m()
    assert abs(east) < _LIMIT_M, f"{rounded(east)} m off to the east"
    assert abs(north) < _LIMIT_M, f"{rounded(north)} m off to the north"


def _not_used(subject: Subject, counter: str, fault: str, **how: float) -> None:
    """Check that frames with a fault count as lost, and in a counter."""
    bench = subject.navigating()
    before = _counter(bench, counter)
    bench.inject(fault, message=_SENSOR, **how)
    _lost(bench, 4)
    assert _counter(bench, counter) > before, f"{counter} does not count them"
    _still_navigates(bench)


@check("firmware.md#frames-in", "RX-041-1")
def wrong_crc(subject: Subject) -> None:
    """A frame with a wrong CRC is counted and never used."""
    _not_used(subject, "crc_errors", "corrupt")


@check("firmware.md#frames-in", "RX-041-3")
def late_frames(subject: Subject) -> None:
    """A frame of another epoch is counted and never used."""
    _not_used(subject, "counter_errors", "delay", delay_s=0.005)


@check("firmware.md#frames-in", "RX-041-3")
def stale_counter(subject: Subject) -> None:
    """A frame that repeats an earlier counter is counted and never used."""
    _not_used(subject, "counter_errors", "stale")


@check("firmware.md#frames-in", "RX-041-4")
def repeated_frames(subject: Subject) -> None:
    """A second frame of its message in the epoch is counted and never used."""
    bench = subject.navigating()
    before = _counter(bench, "counter_errors")
    bench.inject("duplicate", message=_SENSOR)
    bench.advance(1)
    bench.clear_faults()
    assert _counter(bench, "counter_errors") > before, "counter_errors does not count them"
    _still_navigates(bench)


@check("firmware.md#two-senders-of-one-message", "RX-041-5")
def disagreeing_frames(subject: Subject) -> None:
    """Of two frames that disagree about an epoch neither is used."""
    bench = subject.navigating()
    for _ in range(40):  # just before the hardware's own frame of the same epoch
        bench.send(_SENSOR, gyro_dtheta=_WRONG_DATA * 4e-9 / 2, status=0)
        bench.advance(bench.scenario.period_ns / 1e9)
    status = bench.last("FIRMWARE_STATUS")
    assert status is not None
    assert status["usable_sensors"] == 3, "one of two frames that disagree is used"
    _still_navigates(bench)


@check("firmware.md#fusion", "SEN-3")
def gap_bridged(subject: Subject) -> None:
    """A gap in the sensor data up to `bridge_s` is bridged, and its epochs are counted."""
    bench = subject.navigating()
    before = _counter(bench, "bridged_epochs")
    for number in range(1, 5):
        bench.inject("drop", message=f"SENSOR_{number}", for_s=0.05)
    bench.advance(0.3)
    bridged = _counter(bench, "bridged_epochs") - before
    assert bridged == 10, f"bridged_epochs counts {bridged} of 10 epochs without sensors"
    _still_navigates(bench)


@check("firmware.md#fusion", "SEN-4")
def gap_too_long(subject: Subject) -> None:
    """A longer gap ends navigation in FAULT (SENSORS_LOST), which sends no NAV_ frames."""
    bench = subject.navigating()
    for number in range(1, 5):
        bench.inject("drop", message=f"SENSOR_{number}", for_s=0.5)
    where = {"mode": "FAULT", "fault": "SENSORS_LOST"}
    bench.expect("FIRMWARE_STATUS", within=0.5, where=where)
    bench.expect_not("NAV_LATITUDE", within=0.5)


@check("firmware.md#fusion", "SEN-2")
def three_sensors(subject: Subject) -> None:
    """With three of four sensors navigation goes on."""
    bench = subject.navigating()
    bench.inject("gyro_absent", sensor=1)
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"usable_sensors": 3})
    _still_navigates(bench)


@check("firmware.md#clock", "CLK-1 CLK-2")
def sync_lost(subject: Subject) -> None:
    """`sync_lost` after 10 epochs without SYNC, cleared by the next; navigation goes on."""
    bench = subject.navigating()
    bench.inject("drop", message="SYNC", for_s=0.2)
    bench.expect("FIRMWARE_STATUS", within=0.3, where={"sync_lost": 1})
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"sync_lost": 0})
    _still_navigates(bench)


@check("firmware.md#frames-in", "IN-3")
def overload(subject: Subject) -> None:
    """A second of 200 strange frames an epoch does navigation no harm."""
    bench = subject.navigating()
    bench.inject("babble", frames_per_epoch=200, for_s=1.0)
    bench.advance(1.2)
    _still_navigates(bench)


@check("firmware.md#frames-in", "IN-1 RX-041-2")
def strange_frames(subject: Subject) -> None:
    """Unknown, extended and remote frames are ignored; a short one counts as a wrong CRC."""
    bench = subject.navigating()
    before = dict(bench.fault_counters)
    for message in (
        can.Message(arbitration_id=_UNKNOWN, is_extended_id=False, data=bytes(8)),
        can.Message(arbitration_id=0x10, is_extended_id=True, data=bytes(8)),
        can.Message(arbitration_id=0x041, is_extended_id=False, is_remote_frame=True, dlc=8),
    ):
        bench.send_frame(message)
        bench.advance(0.1)
    bench.send_frame(can.Message(arbitration_id=0x041, is_extended_id=False, data=bytes(3)))
    bench.advance(0.1)
    _still_navigates(bench)
    after = bench.fault_counters
    assert after["crc_errors"] == before["crc_errors"] + 1, "only the short frame is an error"
