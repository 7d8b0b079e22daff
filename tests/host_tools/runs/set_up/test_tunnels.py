"""When a receiver has no fix: by time, by the way, by a map; against the motion itself."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import rrins
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.motion.trajectory import PLACE, VELOCITY_N
from rrins.host_tools.runs.set_up.settings import hardware_settings, trajectory_of

METRES = 111_000.0  # of a degree of latitude, at 40°, within 0.1 %


def drive(**gnss):
    return rrins.load_scenario("drive_aided", duration_s=200, gnss=gnss)


def found(scenario):
    """Return the first and the last time without a fix, since navigation begins."""
    settings = hardware_settings(scenario)
    begin, rate = scenario.navigation_epoch, scenario.rate_hz
    return [((a - begin) / rate, (b - begin) / rate) for a, b in settings.gnss_outages]


@pytest.fixture(scope="module")
def motion():
    """Return times, the way and the place (°) of the drive, each second."""
    trajectory = trajectory_of(drive())
    fine = np.arange(0, 200.0005, 1e-3)
    speed = np.linalg.norm(trajectory.at(fine)[:, VELOCITY_N], axis=1)
    rows = trajectory.at(np.arange(201.0))
    way = np.concatenate(([0], np.cumsum(speed[:-1]) * 1e-3))[::1000]
    return np.arange(201.0), way, np.degrees(rows[:, PLACE][:, :2])


def test_a_tunnel_is_a_stretch_of_the_way(motion):
    time_s, way, _ = motion
    tunnels = [
        {"from_m": 150, "to_m": 400},
        {"from_m": 300, "to_m": 500},
        {"from_m": 1e6, "to_m": 2e6},
    ]
    timed = [{"at_s": 20, "for_s": 5}]
    stretches = found(drive(tunnels=tunnels, outages=timed))
    assert len(stretches) == 2  # two tunnels that overlap are one
    inside = time_s[(way >= 150) & (way <= 500)]
    assert stretches[1] == pytest.approx((inside[0], inside[-1]), abs=1.01)
    assert stretches[1][1] - stretches[1][0] > 5


def test_a_vehicle_that_stops_in_a_tunnel_stays_without(motion):
    scenario = drive(tunnels=[{"from_m": 300, "to_m": 1e7}])
    ((_, last),) = found(scenario)
    assert last * scenario.rate_hz + scenario.navigation_epoch >= scenario.epochs - scenario.rate_hz


def write(path, *geometries):
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return str(path)


def test_a_map_has_areas_and_lines(motion, tmp_path):
    time_s, _, place = motion
    latitude, longitude = place[100]
    high, wide = 60 / METRES, 60 / METRES / math.cos(math.radians(latitude))
    square = [
        [longitude + e * wide, latitude + n * high]
        for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    ]
    hole = [
        [longitude + e * wide / 4, latitude + n * high / 4]
        for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    ]
    off = np.abs(place - place[100]) / [high, wide]
    inside = (off < 1).all(axis=1) & ~(off < 0.25).all(axis=1)
    area = write(tmp_path / "area.geojson", {"type": "Polygon", "coordinates": [square, hole]})
    without = np.zeros(201, dtype=bool)
    for first, last in found(drive(tunnel_map=area)):
        without |= (time_s >= first - 0.01) & (time_s <= last + 0.01)
    assert inside.any()
    assert np.array_equal(without, inside)

    line = write(
        tmp_path / "line.geojson",
        {"type": "Point", "coordinates": [0, 0]},
        {"type": "LineString", "coordinates": place[60:81, ::-1].tolist()},
    )
    stretches = found(drive(tunnel_map=line, tunnel_width_m=6))
    assert stretches[0][0] <= 60 <= 80 <= stretches[-1][1]
    wide_one = found(drive(tunnel_map=line, tunnel_width_m=60))
    assert wide_one[0][0] < stretches[0][0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        ("{", "not GeoJSON"),
        ("[1]", "not GeoJSON"),
        ('{"type": "Feature", "geometry": null}', "neither polygons nor lines"),
        ('{"type": "LineString", "coordinates": [["a", 1], [2, 3]]}', "not GeoJSON"),
        ('{"type": "LineString", "coordinates": [[1], [2]]}', "not GeoJSON"),
    ],
)
def test_a_map_that_is_none_is_one_line(tmp_path, text, words):
    path = tmp_path / "map.geojson"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ScenarioError, match=words) as caught:
        hardware_settings(drive(tunnel_map=str(path)))
    assert "\n" not in str(caught.value)
    assert "gnss.tunnel_map" in str(caught.value)


def test_tunnels_are_for_a_vehicle_that_goes_somewhere():
    still = rrins.load_scenario("ideal", gnss={"tunnels": [{"from_m": 1, "to_m": 2}]})
    with pytest.raises(ScenarioError, match=r"motion\.kind"):
        hardware_settings(still)
    with pytest.raises(ScenarioError, match=r"gnss.tunnels.1.*to_m"):
        drive(tunnels=[{"from_m": 2, "to_m": 1}])
