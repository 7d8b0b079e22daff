"""NMEA 0183 sentences of the navigation output.

Formats follow NMEA 0183 version 3.01, and PASHR as NovAtel, Trimble, Applanix, OxTS and SBG
send it. The talker is IN, integrated navigation. Angles are in degrees, heights above the WGS-84
ellipsoid. Before navigation, and in FAULT, sentences are void: their values are empty.

Every number is rounded to whole steps of its last digit before it is split up, so no field can
read 60 minutes or 360 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

from rrins.compiled.record import Records
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.serial.settings import DEFAULT_UTC, SENTENCE_NAMES

TALKER = "IN"
"""Integrated navigation."""

KNOT = 1852.0 / 3600.0
"""A knot in m/s."""

_NAVIGATION = (int(Mode.NAVIGATION_STRAPDOWN), int(Mode.NAVIGATION_ROTATING))
_MINUTE_STEPS = 10_000_000  # 1e-7 minutes of arc: 0.19 mm
_STATUS = ("", "S", "C", "U")  # by `IntegrityStatus`
_DEAD_RECKONING = 6  # GGA quality "estimated"


@dataclass(frozen=True, slots=True)
class Fix:
    """The content of the sentences.

    Attributes
    ----------
    latitude_deg, longitude_deg : float
        Geodetic; east positive.
    speed_mps, course_deg : float
        Horizontal velocity over ground; the course clockwise from true north.
    roll_deg, pitch_deg, heading_deg : float
        Of the body; positive right side down, nose up, clockwise from true north.
    """

    utc: datetime | None  #: None until a SYNC has given the epoch
    #: whether the firmware navigates; otherwise the other values are meaningless
    is_valid: bool = False
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    height_m: float = 0.0  #: above the ellipsoid
    speed_mps: float = 0.0
    course_deg: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    heading_deg: float = 0.0
    #: navigational status of NMEA 4.1: safe, caution, unsafe; empty where it is not known
    status: str = ""


def fix_of(ram: Records[Ram], utc: datetime = DEFAULT_UTC) -> Fix:
    """Return the fix that a RAM image holds; epoch 0 is at `utc`."""
    state = ram[0]
    time = None
    if state.clock.synchronised:
        since_ns = int(state.epoch) * int(state.parameters.period_ns)
        time = utc + timedelta(microseconds=since_ns // 1000)
    if int(state.modes.mode) not in _NAVIGATION:
        return Fix(time)
    output = state.navigation
    latitude, longitude = float(output.latitude), float(output.longitude)
    height = float(output.height)
    east, north, up = output.velocity_n.tolist()
    roll, pitch, heading = float(output.roll), float(output.pitch), float(output.heading)
    if not math.isfinite(
        latitude + longitude + height + east + north + up + roll + pitch + heading
    ):
        return Fix(time)
    return Fix(
        time,
        True,
        math.degrees(latitude),
        math.degrees(longitude),
        height,
        math.hypot(east, north),
        math.degrees(math.atan2(east, north)),
        math.degrees(roll),
        math.degrees(pitch),
        math.degrees(heading),
        _STATUS[int(state.integrity.status)],
    )


def checksum(body: str) -> int:
    """Return the exclusive or of the characters between ``$`` and ``*``."""
    total = 0
    for byte in body.encode("ascii"):
        total ^= byte
    return total


def sentence(body: str) -> bytes:
    """Return a complete sentence: ``$body*hh`` and CR LF."""
    return f"${body}*{checksum(body):02X}\r\n".encode("ascii")


def _coordinate(value_deg: float, digits: int, letters: str) -> str:
    """Return ``d…dmm.mmmmmmm,letter``; `letters` are for the positive and negative hemispheres."""
    steps = round(abs(value_deg) * 60 * _MINUTE_STEPS)
    minutes, fraction = divmod(steps, _MINUTE_STEPS)
    degrees, minutes = divmod(minutes, 60)
    letter = letters[value_deg < 0 and steps > 0]
    return f"{degrees:0{digits}d}{minutes:02d}.{fraction:07d},{letter}"


def _position(fix: Fix) -> str:
    latitude = _coordinate(fix.latitude_deg, 2, "NS")
    return f"{latitude},{_coordinate(fix.longitude_deg, 3, 'EW')}"


def _bearing(value_deg: float, decimals: int = 3) -> str:
    """Return an angle in [0, 360) as ``hhh.hhh``."""
    steps = 10**decimals
    whole, fraction = divmod(round(value_deg * steps) % (360 * steps), steps)
    return f"{whole:03d}.{fraction:0{decimals}d}"


def _signed(value: float, plus: str = "+") -> str:
    """Return a number with three decimals and a sign; zero is positive."""
    steps = round(value * 1000)
    whole, fraction = divmod(abs(steps), 1000)
    return f"{'-' if steps < 0 else plus}{whole}.{fraction:03d}"


def _time(fix: Fix) -> str:
    utc = fix.utc
    if utc is None:
        return ""
    return f"{utc.hour:02d}{utc.minute:02d}{utc.second:02d}.{utc.microsecond // 1000:03d}"


def _date(fix: Fix) -> str:
    utc = fix.utc
    return "" if utc is None else f"{utc.day:02d}{utc.month:02d}{utc.year % 100:02d}"


def gga(fix: Fix) -> str:
    """Return GGA: position, quality and height.

    The computer has no geoid: the height above the ellipsoid is given as that above the geoid,
    with a separation of zero, so that their sum is right.
    """
    if not fix.is_valid:
        return f"{TALKER}GGA,{_time(fix)},,,,,0,,,,M,,M,,"
    height = _signed(fix.height_m, "")
    position = _position(fix)
    return f"{TALKER}GGA,{_time(fix)},{position},{_DEAD_RECKONING},,,{height},M,0.000,M,,"


def rmc(fix: Fix) -> str:
    """Return RMC: position, speed in knots and course, date.

    Where the integrity is known, the navigational status of NMEA 4.1 follows, for a decimal each of
    speed and course.

    The course is empty when the speed rounds to zero; it has two decimals, so that the
    sentence does not exceed the 82 characters that NMEA allows.
    """
    if not fix.is_valid:
        return f"{TALKER}RMC,{_time(fix)},V,,,,,,,{_date(fix)},,,N"
    speed = _signed(fix.speed_mps / KNOT, "")
    course = _bearing(fix.course_deg, 2) if speed != "0.000" else ""
    status = ""
    if fix.status:
        status, speed = f",{fix.status}", speed[:-1]
        course = course and _bearing(fix.course_deg, 1)
    return f"{TALKER}RMC,{_time(fix)},A,{_position(fix)},{speed},{course},{_date(fix)},,,E{status}"


def hdt(fix: Fix) -> str:
    """Return HDT: true heading."""
    return f"{TALKER}HDT,{_bearing(fix.heading_deg) if fix.is_valid else ''},T"


def pashr(fix: Fix) -> str:
    """Return PASHR: heading, roll and pitch; heave and standard deviations are empty."""
    if not fix.is_valid:
        return f"PASHR,{_time(fix)},,,,,,,,,0,0"
    attitude = f"{_bearing(fix.heading_deg)},T,{_signed(fix.roll_deg)},{_signed(fix.pitch_deg)}"
    return f"PASHR,{_time(fix)},{attitude},,,,,{_DEAD_RECKONING},1"


def tnthtm(fix: Fix) -> str:
    """Return PTNTHTM: heading, pitch and roll; the magnetic fields are empty.

    Of the attitude sentences, the one whose roll and pitch gpsd reports.
    """
    if not fix.is_valid:
        return "PTNTHTM,,,,,,,,"
    pitch, roll = _signed(fix.pitch_deg, ""), _signed(fix.roll_deg, "")
    return f"PTNTHTM,{_bearing(fix.heading_deg)},,{pitch},N,{roll},N,,"


SENTENCES: dict[str, Callable[[Fix], str]] = dict(
    zip(SENTENCE_NAMES, (pashr, tnthtm, hdt, gga, rmc), strict=True)
)
"""By name, in the order in which they are sent."""


def encode(fix: Fix, names: tuple[str, ...] = SENTENCE_NAMES) -> list[bytes]:
    """Return the named sentences of a fix, ready to send."""
    return [sentence(make(fix)) for name, make in SENTENCES.items() if name in names]
