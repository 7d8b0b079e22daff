"""NMEA sentences: read back by pynmea2, exact where readers stumble, void before navigation."""

from __future__ import annotations

import math
import re
from datetime import UTC, date, datetime, time

import numpy as np
import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest, fail
from rrins.firmware_py.serial import nmea

NOON = datetime(2026, 8, 1, 12, 34, 56, 250_000, tzinfo=UTC)
LONGEST = 82
"""Characters of a sentence with CR LF, by NMEA 0183."""


def fix(**values):
    return nmea.Fix(**({"utc": NOON, "is_valid": True} | values))


def parse(each, fields):
    """Return what pynmea2 reads, its checksum checked, and the number of fields as expected."""
    line = nmea.sentence(each).decode("ascii")
    assert line.endswith("\r\n")
    assert len(line) <= LONGEST
    found = pynmea2.parse(line, check=True)
    assert len(line.split(",")) == fields
    return found


def angle_between(a, b):
    return abs((a - b + 180) % 360 - 180)


coordinates = st.tuples(
    st.floats(-90, 90), st.floats(-180, 180), st.floats(-1000, 99999.9), st.floats(0, 3000)
)
angles = st.floats(-720, 720)


@given(coordinates)
def test_position_comes_back_to_a_millimetre(values):
    latitude, longitude, height, speed = values
    given_fix = fix(
        latitude_deg=latitude, longitude_deg=longitude, height_m=height, speed_mps=speed
    )
    gga = parse(nmea.gga(given_fix), 15)
    rmc = parse(nmea.rmc(given_fix), 13)
    half_a_step = 0.5e-7 / 60 + 1e-12
    for found in (gga, rmc):
        assert abs(found.latitude - latitude) <= half_a_step
        assert abs(found.longitude - longitude) <= half_a_step
        assert found.timestamp == time(12, 34, 56, 250_000, tzinfo=UTC)
        assert re.fullmatch(r"\d{4}\.\d{7}", found.lat)
        assert re.fullmatch(r"\d{5}\.\d{7}", found.lon)
        assert float(found.lat) % 100 < 60
        assert float(found.lon) % 100 < 60
    assert gga.gps_qual == 6
    assert gga.num_sats == gga.horizontal_dil == ""
    assert abs(gga.altitude + float(gga.geo_sep) - height) <= 0.0005001
    assert gga.altitude_units == gga.geo_sep_units == "M"
    assert rmc.status == "A"
    assert rmc.is_valid
    assert rmc.mode_indicator == "E"
    assert rmc.datestamp == date(2026, 8, 1)
    assert abs(rmc.spd_over_grnd * 1852 / 3600 - speed) <= 0.0003


@given(angles, angles, st.floats(-180, 180), st.floats(-90, 90))
def test_angles_come_back_to_half_a_step(course, heading, roll, pitch):
    values = fix(
        course_deg=course, heading_deg=heading, roll_deg=roll, pitch_deg=pitch, speed_mps=1
    )
    half = 0.00050001
    rmc = parse(nmea.rmc(values), 13)
    assert 0 <= rmc.true_course < 360
    assert angle_between(rmc.true_course, course) <= 10 * half
    hdt = parse(nmea.hdt(values), 3)
    assert 0 <= hdt.heading < 360
    assert hdt.hdg_true == "T"
    assert angle_between(float(hdt.heading), heading) <= half
    attitude = parse(nmea.pashr(values), 12)
    assert 0 <= attitude.true_heading < 360
    assert attitude.is_true_heading == "T"
    assert angle_between(attitude.true_heading, heading) <= half
    assert abs(attitude.roll - roll) <= half
    assert abs(attitude.pitch - pitch) <= half
    assert attitude.timestamp == time(12, 34, 56, 250_000, tzinfo=UTC)
    assert attitude.heave is attitude.roll_accuracy is None
    assert (attitude.aiding_status, attitude.imu_status) == (6, 1)
    fields = parse(nmea.tnthtm(values), 9).data
    assert angle_between(float(fields[1]), heading) <= half
    assert abs(float(fields[3]) - pitch) <= half
    assert abs(float(fields[5]) - roll) <= half


def test_sentences_to_the_byte():
    values = fix(
        latitude_deg=-33.8568,
        longitude_deg=151.2153,
        height_m=58.5,
        speed_mps=10.0,
        course_deg=-10.0,
        roll_deg=1.25,
        pitch_deg=-2.5,
        heading_deg=217.4,
    )
    assert nmea.encode(values) == [
        b"$PASHR,123456.250,217.400,T,+1.250,-2.500,,,,,6,1*10\r\n",
        b"$PTNTHTM,217.400,,-2.500,N,1.250,N,,*4D\r\n",
        b"$INHDT,217.400,T*25\r\n",
        b"$INGGA,123456.250,3351.4080000,S,15112.9180000,E,6,,,58.500,M,0.000,M,,*7E\r\n",
        b"$INRMC,123456.250,A,3351.4080000,S,15112.9180000,E,19.438,350.00,010826,,,E*65\r\n",
    ]
    assert nmea.encode(values, ("RMC", "HDT")) == [nmea.encode(values)[i] for i in (2, 4)]


@pytest.mark.parametrize(
    ("latitude", "longitude", "field"),
    [
        (40 + 59.99999999 / 60, 0.0, "4100.0000000,N,00000.0000000,E"),
        (-(40 + 59.99999999 / 60), 0.0, "4100.0000000,S,00000.0000000,E"),
        (40 + 59.9999999 / 60, 0.0, "4059.9999999,N,00000.0000000,E"),
        (89.999999999999, -179.999999999999, "9000.0000000,N,18000.0000000,W"),
        (-1e-13, -1e-13, "0000.0000000,N,00000.0000000,E"),
        (-0.0, 0.0, "0000.0000000,N,00000.0000000,E"),
        (-1e-8, -1e-8, "0000.0000006,S,00000.0000006,W"),
        (9.0, 9.0, "0900.0000000,N,00900.0000000,E"),
    ],
)
def test_minutes_never_reach_sixty(latitude, longitude, field):
    position = fix(latitude_deg=latitude, longitude_deg=longitude)
    assert field in nmea.gga(position)
    assert field in nmea.rmc(position)


@pytest.mark.parametrize(
    ("heading", "field", "course"),
    [
        (359.9996, "000.000", "000.00"),
        (359.9994, "359.999", "000.00"),
        (359.9949, "359.995", "359.99"),
        (360.0, "000.000", "000.00"),
        (-0.0001, "000.000", "000.00"),
    ],
)
def test_a_heading_never_reads_360(heading, field, course):
    assert nmea.hdt(fix(heading_deg=heading)) == f"INHDT,{field},T"
    assert f",{field},T," in nmea.pashr(fix(heading_deg=heading))
    assert f",{course},010826," in nmea.rmc(fix(course_deg=heading, speed_mps=1))


def test_zero_has_no_minus():
    values = fix(roll_deg=-0.0004, pitch_deg=-0.0, height_m=-0.0004)
    assert ",T,+0.000,+0.000," in nmea.pashr(values)
    assert ",6,,,0.000,M," in nmea.gga(values)


def test_there_is_no_course_without_speed():
    assert ",E,0.000,,010826," in nmea.rmc(fix(speed_mps=0.0002, course_deg=123))
    assert ",E,0.001,123.00,010826," in nmea.rmc(fix(speed_mps=0.0004, course_deg=123))


def test_void_sentences_hold_no_values():
    lines = nmea.encode(nmea.Fix(NOON))
    assert lines == [
        b"$PASHR,123456.250,,,,,,,,,0,0*6A\r\n",
        b"$PTNTHTM,,,,,,,,*4F\r\n",
        b"$INHDT,,T*0B\r\n",
        b"$INGGA,123456.250,,,,,0,,,,M,,M,,*68\r\n",
        b"$INRMC,123456.250,V,,,,,,,010826,,,N*50\r\n",
    ]
    for line in lines:
        pynmea2.parse(line.decode(), check=True)
    rmc, gga = (pynmea2.parse(lines[i].decode()) for i in (4, 3))
    assert not rmc.is_valid
    assert not gga.is_valid


def test_before_sync_there_is_no_time():
    assert nmea.rmc(nmea.Fix(None)) == "INRMC,,V,,,,,,,,,,N"
    assert nmea.gga(nmea.Fix(None)) == "INGGA,,,,,,0,,,,M,,M,,"


def test_the_fix_is_that_of_the_firmware(tools):
    bench = tools.Bench(latitude_deg=-33.5, longitude_deg=-151.25, height_m=12, heading_deg=300)
    assert nmea.fix_of(bench.ram) == nmea.Fix(None)
    bench.step()
    assert nmea.fix_of(bench.ram) == nmea.Fix(nmea.DEFAULT_UTC)
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    bench.step()
    start = datetime(2023, 12, 31, 23, 59, 59, 999_000, tzinfo=UTC)
    found = nmea.fix_of(bench.ram, start)
    assert found.is_valid
    assert (found.utc - start).total_seconds() == pytest.approx(bench.state["epoch"] * 0.005)
    assert found.latitude_deg == pytest.approx(-33.5, abs=1e-8)
    assert found.longitude_deg == pytest.approx(-151.25, abs=1e-8)
    assert found.height_m == pytest.approx(12)
    assert found.heading_deg == pytest.approx(300, abs=1e-3)
    assert found.speed_mps == pytest.approx(0, abs=1e-3)
    assert ",010124," in nmea.rmc(found)
    fail(bench.ram[0], FirmwareFault.SENSORS_LOST)
    assert not nmea.fix_of(bench.ram).is_valid


@pytest.mark.slow
@given(st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-100, 100), st.integers(0, 10**10))
def test_course_and_speed_are_those_of_the_velocity(tools, east, north, up, epoch):
    bench = tools.Bench()
    state = bench.ram[0]
    state["clock"]["synchronised"] = True
    state["modes"]["mode"] = Mode.NAVIGATION_ROTATING
    state["epoch"] = epoch
    state["navigation"]["velocity_n"] = (east, north, up)
    found = nmea.fix_of(bench.ram)
    course = math.radians(found.course_deg)
    assert found.speed_mps * math.sin(course) == pytest.approx(east, abs=1e-9)
    assert found.speed_mps * math.cos(course) == pytest.approx(north, abs=1e-9)


@pytest.mark.parametrize("name", ["latitude", "height", "velocity_n", "heading"])
def test_a_solution_that_is_no_number_is_void(tools, name):
    bench = tools.Bench()
    bench.state["modes"]["mode"] = Mode.NAVIGATION_STRAPDOWN
    bench.state["navigation"][name] = np.nan
    assert nmea.fix_of(bench.ram) == nmea.Fix(None)
