"""The numbered requirements of the bus on a navigation computer, and the checks that try them."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

from rrins.dbc.codec import load
from rrins.host_tools.conformance.answers import SENT
from rrins.host_tools.conformance.check import Check
from rrins.host_tools.files import JsonObject


@dataclass(frozen=True)
class Requirement:
    """A demand on a navigation computer."""

    number: str
    text: str
    page: str  #: page and anchor in the docs


RECEIVED_TEXTS: Final = (
    "A frame with a wrong CRC increments `crc_errors` and is not used.",
    "A frame that does not have eight bytes increments `crc_errors` and is not used.",
    "A frame with the counter of another epoch (MODE_COMMAND: of the frame before) increments "
    "`counter_errors` and is not used.",
    "A second frame of the same epoch increments `counter_errors` and is not used.",
    "Two frames of the same epoch that disagree are both not used.",
    "Its loss has the effect that the firmware page states, and no other.",
)
"""Demands of each message received, numbered from 1."""

SENT_TEXTS: Final = (
    "It has eight bytes, a right CRC, and 0 in the bits of no signal.",
    "Its counter goes on by one with each transmission, from 0; that of an axis command is the "
    "epoch modulo 15.",
    "It is sent at its cycle time, in the epochs that are a multiple of it, and at no other time.",
    "Its signals are those of the reference, within rounding.",
)
"""Demands of each message sent, numbered from 1."""

RECEIVED: Final = (
    "SYNC",
    "MODE_COMMAND",
    *(f"SENSOR_{k}" for k in range(1, 17)),
    "ALTIMETER",
    "AXIS_INNER_STATUS",
    "AXIS_OUTER_STATUS",
)
"""Messages that every navigation computer receives, if it has the part."""

_MODES, _IN, _OUT = "firmware.md#modes", "firmware.md#frames-in", "firmware.md#frames-out"
_FUSION, _CLOCK = "firmware.md#fusion", "firmware.md#clock"
_ALIGN, _CODES = "firmware.md#alignment", "diagnostics.md#trouble-codes"
_SCHEME, _STRAPDOWN = "firmware.md#rotation-scheme", "firmware.md#strapdown"
_POWER = "firmware.md#power"
_SET_UP, _CALLED = "own-firmware.md#the-set-up", "own-firmware.md#how-a-program-is-called"
_UDS = "diagnostics.md#sessions-and-security"

OTHERS: Final = (
    ("MODE-1", "The self-test takes 0.5 s of sound epochs; an unsound one costs ten.", _MODES),
    ("MODE-2", "After 10 s the self-test ends in FAULT (SELF_TEST_FAILED).", _MODES),
    ("MODE-3", "A request is acted on once, when it differs from the one before.", _MODES),
    ("MODE-4", "A request to align or navigate during the self-test is remembered.", _MODES),
    ("MODE-5", "The alignment begins once both axes stand, or after 10 s in STANDBY.", _MODES),
    ("MODE-6", "ALIGN alone waits in ALIGNMENT; ALIGN in navigation does nothing.", _MODES),
    ("MODE-7", "A change between the navigation modes keeps the solution.", _MODES),
    ("MODE-8", "FAULT sends all frames but NAV_, and ends on a request for STANDBY.", _MODES),
    ("MODE-9", "SHUTDOWN, in any mode: both axes OFF, and the program ends with 0.", _MODES),
    ("PWR-1", "After a loss of power it begins anew and navigates; nothing is counted.", _POWER),
    ("PWR-2", "`began_late`: its first SYNC came after the hardware's first second.", _POWER),
    ("PRG-1", "A spoilt set-up ends the program with a line and a status other than 0.", _SET_UP),
    ("PRG-2", "Keys of the set-up that it does not know are skipped.", _SET_UP),
    ("PRG-3", "SIGTERM ends the program.", _CALLED),
    ("PRG-4", "The end of its bus ends it with a line and a status other than 0.", _CALLED),
    ("IN-1", "Unknown identifiers, extended and remote frames are ignored.", _IN),
    ("IN-2", "Any mixture of lost, wrong, late and repeated frames is counted, each once.", _IN),
    ("IN-3", "A flood of frames does the navigation no harm.", _IN),
    ("IN-4", "Missing frames are counted from the first SYNC on.", _IN),
    ("IN-5", "A MODE_COMMAND with the counter of the one before is not a request.", _IN),
    ("SYN-1", "A SYNC ahead of the epoch is counted and ignored (lockstep).", _IN),
    ("SYN-2", "A SYNC behind, or a second one of the epoch, is counted and changes no epoch.", _IN),
    ("SYN-3", "A SYNC more than 200 epochs off is adopted if the next one continues it.", _IN),
    ("SYN-4", "Epochs go on over the wrap of SYNC's 24 bits.", _IN),
    ("SYN-5", "The first SYNC sets the epoch; its counter tells how often it has wrapped.", _IN),
    ("CLK-1", "Without SYNC the epochs go on.", _CLOCK),
    ("CLK-2", "`sync_lost` is set after 10 epochs without SYNC and cleared by the next.", _CLOCK),
    ("CLK-3", "In real time a clock error is learned; commands are in time.", _CLOCK),
    ("CLK-4", "A stall of either side is survived; commands are in time 1 s later.", _CLOCK),
    ("CLK-5", "`load_percent` is the share of a period that the loop computes.", _CLOCK),
    ("SEN-1", "A saturated or absent sensor is not used; the other of its group is.", _IN),
    ("SEN-2", "With three of four sensors navigation goes on.", _FUSION),
    ("SEN-3", "Gaps up to `bridge_s` are bridged by the increments before; counted.", _FUSION),
    ("SEN-4", "A longer gap ends navigation in FAULT (SENSORS_LOST).", _FUSION),
    ("SEN-5", "Sensors of any number, direction and weight are fused by least squares.", _FUSION),
    ("CNT-1", "Fault counters saturate.", "firmware.md#fault-counters"),
    ("OUT-1", "Cycle times are rounded down to whole epochs, but at least one.", _OUT),
    ("OUT-2", "Axis commands are the last frames of the epoch, the outer one at the end.", _OUT),
    ("AXS-1", "Targets add up over cycles; a position lasts its turn and dwell.", _SCHEME),
    ("AXS-2", "`rate_limit_dps` is the turn rate; HOLD in every mode but rotation.", _SCHEME),
    ("AXS-3", "An axis that lags, is silent or reports FAULT is reported, and both hold.", _SCHEME),
    ("AXS-4", "The rotation is tried again after 1, 2, 4 … 128 s, once both axes hold.", _SCHEME),
    ("AXS-5", "After eight tries the rotation is given up.", _SCHEME),
    ("AXS-6", "The scheme begins at zero, to which both axes are turned back first.", _SCHEME),
    ("ALN-1", "Level and heading are given, or found from gravity and the Earth's rate.", _ALIGN),
    ("ALN-2", "A specific force that is 2 % off ends in FAULT (ALIGNMENT_FAILED).", _ALIGN),
    ("NAV-1", "Position, velocity and attitude are those of the reference.", _STRAPDOWN),
    ("NAV-2", "Coning, sculling, Coriolis and the transport rate are compensated.", _STRAPDOWN),
    ("NAV-3", "The height is held, damped or free, as set up.", "firmware.md#height-channel"),
    ("NAV-4", "With an altimeter the damped height follows it.", "firmware.md#height-channel"),
    ("NAV-5", "3000 m/s or 89.99° of latitude end in FAULT (NAVIGATION_DIVERGED).", _MODES),
    ("NAV-6", "Longitude wraps at 180°; outputs stay at the ends of their ranges.", _STRAPDOWN),
    ("UDS-1", "What cannot be is answered by the negative response of ISO 14229-1.", _UDS),
    ("UDS-2", "A session ends 5 s after the last request; TesterPresent keeps it.", _UDS),
    ("UDS-3", "Seeds and keys: wrong ones are refused, the third for 10 s.", _UDS),
    ("UDS-4", "What changes the computer needs SecurityAccess.", _UDS),
    ("UDS-5", "Every change of session locks the computer again.", _UDS),
    ("UDS-6", "A reset while it navigates is refused unless it is unlocked.", _UDS),
    ("UDS-7", "A fault sets its trouble code; clearing removes it.", _CODES),
)  # fmt: skip
"""Number, demand, page."""


@cache
def requirements() -> tuple[Requirement, ...]:
    """Return all requirements in the order of their pages."""
    found = [Requirement(number, text, page) for number, text, page in OTHERS]
    for letter, names, texts in (("RX", RECEIVED, RECEIVED_TEXTS), ("TX", SENT, SENT_TEXTS)):
        for name in names:
            page = f"bus-contract.md#{'sensor_1' if name.startswith('SENSOR_') else name.lower()}"
            for k, text in enumerate(texts, 1):
                number = f"{letter}-{load().frame_id(name):03X}-{k}"
                found.append(Requirement(number, f"{name}: {text}", page))
    return tuple(found)


def covered_by(check: Check) -> tuple[str, ...]:
    """Return the numbers that a check tries, its patterns resolved."""
    return tuple(
        one.number
        for one in requirements()
        if any(fnmatch.fnmatchcase(one.number, pattern) for pattern in check.requirements)
    )


def matrix(checks: Sequence[Check]) -> list[JsonObject]:
    """Return each requirement with the checks that try it."""
    covered = {check.name: set(covered_by(check)) for check in checks}
    return [
        {
            "requirement": one.number,
            "text": one.text,
            "page": one.page,
            "checks": [name for name, numbers in covered.items() if one.number in numbers],
        }
        for one in requirements()
    ]
