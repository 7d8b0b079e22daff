"""When the GNSS receiver has no fix: times, stretches of the way, and places of a map."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrins.host_tools import files
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware import earth
from rrins.host_tools.hardware.memory import OUTAGE_CAPACITY
from rrins.host_tools.motion.trajectory import PLACE, VELOCITY_N, Trajectory
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Gnss

_WAY_STEP_S = 0.05

_Flags = NDArray[np.bool_]
_Vector = NDArray[np.float64]


def outages(scenario: Scenario, trajectory: Trajectory | None) -> tuple[tuple[int, int], ...]:
    """Return the first and the last epoch of each time without a fix, those of tunnels included.

    Parameters
    ----------
    scenario : Scenario
        With a receiver.
    trajectory : Trajectory or None
        The vehicle's motion; None where it rests.

    Raises
    ------
    ScenarioError
        When the map cannot be read, or there are too many times.
    """
    gnss, rate_hz = scenario.gnss, scenario.rate_hz
    assert gnss is not None
    timed = [(o.at_s, o.at_s + o.for_s) for o in gnss.outages]
    found = [(round(first * rate_hz), round(last * rate_hz)) for first, last in timed]
    if gnss.tunnels or gnss.tunnel_map is not None:
        found += _under_cover(scenario, gnss, trajectory)
    if len(found) > OUTAGE_CAPACITY:
        raise ScenarioError(
            f"gnss: {len(found)} times without a fix on this way, at most {OUTAGE_CAPACITY}"
        )
    return tuple(found)


def _under_cover(
    scenario: Scenario, gnss: Gnss, trajectory: Trajectory | None
) -> list[tuple[int, int]]:
    """Return the stretches of epochs whose fixes are taken in a tunnel."""
    if trajectory is None or trajectory.loop_from is not None:
        raise ScenarioError('gnss: tunnels are for motion.kind = "drive" or "file"')
    every = round(scenario.rate_hz / gnss.rate_hz)
    begin = scenario.navigation_epoch
    end = begin + math.ceil(trajectory.duration_s * scenario.rate_hz)
    epochs = np.arange(-(-begin // every) * every, min(end, scenario.epochs) + every, every)
    time_s = (epochs - begin) / scenario.rate_hz
    covered = np.zeros(len(epochs), dtype=bool)
    way_m = _way(trajectory, time_s)
    for tunnel in gnss.tunnels:
        covered |= (way_m >= tunnel.from_m) & (way_m <= tunnel.to_m)
    if gnss.tunnel_map is not None:
        latitude, longitude, _ = trajectory.at(time_s)[:, PLACE].T
        covered |= _on_map(Path(gnss.tunnel_map), gnss.tunnel_width_m, latitude, longitude)
    steps = np.flatnonzero(np.diff(np.concatenate(([False], covered, [False]))))
    stretches = [(int(epochs[a]), int(epochs[b - 1])) for a, b in steps.reshape(-1, 2)]
    if covered.size and covered[-1]:  # it stands there to the end
        stretches[-1] = (stretches[-1][0], scenario.epochs)
    return stretches


def _way(trajectory: Trajectory, time_s: _Vector) -> _Vector:
    """Return how far the vehicle has come since its motion began, m."""
    fine = np.arange(0.0, trajectory.duration_s + _WAY_STEP_S, _WAY_STEP_S)
    speed = np.linalg.norm(trajectory.at(fine)[:, VELOCITY_N], axis=1)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * _WAY_STEP_S)))
    return np.interp(time_s, fine, way)


def _on_map(path: Path, width_m: float, latitude: _Vector, longitude: _Vector) -> _Flags:
    """Return which positions (rad) are inside an area of a map, or on one of its lines."""
    polygons, lines = _read(path)
    meridian, prime_vertical = earth.curvature_radii(float(latitude[0]))
    scale = np.array([prime_vertical * math.cos(latitude[0]), meridian])

    def flat(points: _Vector) -> _Vector:
        """Return east and north of the first position, m, of longitudes and latitudes."""
        away = points - origin
        away[:, 0] = (away[:, 0] + math.pi) % (2 * math.pi) - math.pi
        return away * scale

    origin = np.array([longitude[0], latitude[0]])
    places = flat(np.column_stack([longitude, latitude]))
    covered = np.zeros(len(places), dtype=bool)
    for rings in polygons:
        covered |= _inside([flat(ring) for ring in rings], places)
    for line in lines:
        points = flat(line)
        for start, end in itertools.pairwise(points):
            covered |= _near(start, end, places) <= width_m / 2
    return covered


def _inside(rings: list[_Vector], places: _Vector) -> _Flags:
    """Return which places are inside a polygon with holes, by the parity of crossings."""
    inside = np.zeros(len(places), dtype=bool)
    east, north = places.T
    for ring in rings:
        for (e0, n0), (e1, n1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            if n0 != n1:
                crosses = (n0 > north) != (n1 > north)
                inside ^= crosses & (east < e0 + (north - n0) / (n1 - n0) * (e1 - e0))
    return inside


def _near(start: _Vector, end: _Vector, places: _Vector) -> _Vector:
    """Return the distance of each place from a straight line between two points, m."""
    along = end - start
    length = float(along @ along)
    share = (places - start) @ along / length if length > 0 else np.zeros(len(places))
    foot = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(places - foot, axis=1))


def _read(path: Path) -> tuple[list[list[_Vector]], list[_Vector]]:
    """Return the polygons, each with its rings, and the lines of a GeoJSON file (RFC 7946).

    Each is of longitudes and latitudes in rad, shape (n, 2).
    """
    try:
        whole = json.loads(files.text_of(path))
    except OSError as error:
        raise ScenarioError(f"gnss.tunnel_map: {path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"gnss.tunnel_map: {path}: not GeoJSON: {error}") from error
    polygons: list[list[_Vector]] = []
    lines: list[_Vector] = []
    try:
        _collect(whole, polygons, lines)
    except (KeyError, TypeError, IndexError, AttributeError, ValueError) as error:
        raise ScenarioError(f"gnss.tunnel_map: {path}: not GeoJSON: {error!r}") from error
    if not polygons and not lines:
        raise ScenarioError(f"gnss.tunnel_map: {path}: neither polygons nor lines in it")
    return polygons, lines


def _points(coordinates: list[list[float]]) -> _Vector:
    """Return longitudes and latitudes, rad, shape (n, 2)."""
    points = np.array([point[:2] for point in coordinates], dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise ValueError("a position that is not longitude and latitude")
    return np.radians(points)


def _collect(item: dict[str, Any], polygons: list[list[_Vector]], lines: list[_Vector]) -> None:
    """Add what an object of GeoJSON has of polygons and lines; points are passed over."""
    kind = item["type"]
    if kind == "FeatureCollection":
        for feature in item["features"]:
            _collect(feature, polygons, lines)
    elif kind == "Feature":
        if item["geometry"] is not None:
            _collect(item["geometry"], polygons, lines)
    elif kind == "GeometryCollection":
        for geometry in item["geometries"]:
            _collect(geometry, polygons, lines)
    elif kind == "Polygon":
        polygons.append([_points(ring) for ring in item["coordinates"]])
    elif kind == "MultiPolygon":
        polygons.extend([_points(ring) for ring in rings] for rings in item["coordinates"])
    elif kind == "LineString":
        lines.append(_points(item["coordinates"]))
    elif kind == "MultiLineString":
        lines.extend(_points(line) for line in item["coordinates"])
