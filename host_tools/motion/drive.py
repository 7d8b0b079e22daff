"""A synthetic drive: a car that starts, turns, goes round roundabouts, climbs hills and stops.

Speed and heading are sums of smooth steps ``35 u⁴ - 84 u⁵ + 70 u⁶ - 20 u⁷``; the road climbs as a
sum of sines over the distance; the body leans outwards in bends and dives under braking. A seed
determines everything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.kinematics import Path, trajectory_of
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.spline import Fit, Grid, Observations
from rrins.host_tools.motion.trajectory import Trajectory, knot_ns

_STEEPEST = 35 / 16  # of the smooth step
_LONGITUDINAL = 1.9  # m/s², largest when accelerating or braking
_LATERAL = 2.3  # m/s², largest in a bend
_LEAN = math.radians(4) / STANDARD_GRAVITY  # rad per m/s², outwards
_NOD = math.radians(2) / STANDARD_GRAVITY  # rad per m/s², nose up when accelerating
_STAND_S = 5.0  # at least, before the start and at the end
_SAMPLE_S = 0.05
_MANOEUVRES = ("left", "right", "roundabout", "stop", "left", "right", "bends", "stop")
# Length (m) and height (m) of the road's undulations.
_HILLS = ((700.0, 3.0), (1900.0, 9.0), (5300.0, 25.0))
_STEEPEST_PITCH = math.radians(60)


@dataclass(frozen=True)
class _Step:
    """A smooth change of a quantity."""

    start_s: float
    length_s: float
    change: float


@dataclass
class _Route:
    """Changes of speed and heading in driving order."""

    generator: np.random.Generator
    time_s: float = _STAND_S
    speed: float = 0.0
    speed_steps: list[_Step] = field(default_factory=list)
    heading_steps: list[_Step] = field(default_factory=list)
    stops: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, _STAND_S)])

    def go(self, speed: float) -> None:
        """Change to a speed, m/s."""
        change = speed - self.speed
        if change:
            length_s = max(2.0, _STEEPEST * abs(change) / _LONGITUDINAL)
            self.speed_steps.append(_Step(self.time_s, length_s, change))
            self.time_s += length_s
            self.speed = speed

    def turn(self, angle_deg: float) -> None:
        """Turn by an angle, clockwise positive, at the current speed."""
        angle = math.radians(angle_deg)
        length_s = max(3.0, _STEEPEST * abs(angle) * self.speed / _LATERAL)
        self.heading_steps.append(_Step(self.time_s, length_s, angle))
        self.time_s += length_s

    def keep(self, low_s: float, high_s: float) -> None:
        """Drive straight on."""
        self.time_s += self.generator.uniform(low_s, high_s)

    def stand(self, low_s: float, high_s: float) -> None:
        """Stop and stand."""
        self.go(0.0)
        begin = self.time_s
        self.keep(low_s, high_s)
        self.stops.append((begin, self.time_s))

    def drive(self, manoeuvre: str) -> None:
        """Drive to the next manoeuvre and through it."""
        draw = self.generator.uniform
        self.go(draw(11.0, 20.0))
        self.keep(4.0, 20.0)
        if manoeuvre in ("left", "right"):
            self.go(draw(5.0, 7.0))
            self.turn(math.copysign(draw(70, 110), 1 if manoeuvre == "right" else -1))
        elif manoeuvre == "roundabout":
            self.go(draw(6.0, 7.0))
            self.turn(45)
            self.turn(-90 * int(self.generator.integers(1, 4)))
            self.turn(45)
        elif manoeuvre == "bends":
            for side in (1, -1, 1, -1):
                self.turn(side * draw(8, 30))
                self.keep(0.0, 6.0)
        else:
            self.stand(8.0, 45.0)

    @property
    def braking_s(self) -> float:
        """Time needed to stop from here."""
        return max(2.0, _STEEPEST * self.speed / _LONGITUDINAL) if self.speed else 0.0


def _route(duration_s: float, generator: np.random.Generator) -> _Route:
    """Return a route that ends at rest at the end of the duration."""
    route = _Route(generator)
    deck: list[str] = []
    while True:
        deck = deck or [*generator.permutation(_MANOEUVRES)]
        before = (route.time_s, route.speed, len(route.speed_steps), len(route.heading_steps))
        stops = len(route.stops)
        route.drive(deck.pop())
        if route.time_s + route.braking_s + _STAND_S > duration_s:
            route.time_s, route.speed = before[:2]
            del route.speed_steps[before[2] :], route.heading_steps[before[3] :]
            del route.stops[stops:]
            break
    if not route.speed_steps:  # too short for any manoeuvre: just go and stop
        route.go(min(15.0, (duration_s - 2 * _STAND_S) * _LONGITUDINAL / (2.5 * _STEEPEST)))
    # Drive straight on for the remaining time, then stop.
    spare_s = duration_s - _STAND_S - route.braking_s - route.time_s
    route.time_s += max(0.0, spare_s) if route.speed else 0.0
    route.go(0.0)
    route.stops.append((route.time_s, duration_s))
    return route


def _sum(steps: list[_Step], start: float, times: Floats) -> tuple[Floats, Floats]:
    """Return the value and its rate at times."""
    value, rate = np.full_like(times, start), np.zeros_like(times)
    for step in steps:
        first, last = np.searchsorted(times, [step.start_s, step.start_s + step.length_s])
        u = (times[first:last] - step.start_s) / step.length_s
        value[first:last] += step.change * u**4 * (35 + u * (u * (70 - 20 * u) - 84))
        value[last:] += step.change
        rate[first:last] += step.change / step.length_s * 140 * (u * (1 - u)) ** 3
    return value, rate


def _integral(rate: Floats) -> Floats:
    """Return the trapezoidal integral from the first sample on."""
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) * (_SAMPLE_S / 2))])


def _road(distance: Floats, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Return height (m) and slope of the road, both 0 at the beginning."""
    height, slope = np.zeros_like(distance), np.zeros_like(distance)
    for length, rise in _HILLS:
        number = 2 * math.pi / (length * generator.uniform(0.8, 1.2))
        rise *= generator.choice([-1, 1]) * generator.uniform(0.8, 1.2)
        height += rise * (1 - np.cos(number * distance))
        slope += rise * number * np.sin(number * distance)
    return height, slope


def _over_ground(local: Local, velocity: Floats) -> Floats:
    """Return local offsets (m, 3) of a velocity over ground, east, north, up in m/s."""
    offsets = np.zeros_like(velocity)
    for _ in range(3):  # the stretch depends on the position: fixed-point iteration
        rates = velocity / local.stretch(offsets)
        offsets = np.stack([_integral(column) for column in rates.T], axis=1)
    return offsets


def synthetic_drive(duration_s: float, seed: int, base: Floats, period_ns: int) -> Trajectory:
    """Return a drive from an initial position and attitude.

    Parameters
    ----------
    duration_s : float
        Duration, including the standstill at both ends.
    seed : int
    base : array, shape (6,)
        Initial latitude, longitude (rad), height (m), roll, pitch, heading (rad); the car sets out
        along the heading. Roll and pitch are added to those of the road throughout.
    period_ns : int
        Sampling period.
    """
    if abs(base[4]) > _STEEPEST_PITCH:
        raise MotionError("motion: a drive cannot start with a pitch beyond 60°")
    step_ns = knot_ns(period_ns)
    step_s = step_ns * 1e-9
    count = round(duration_s / step_s)
    generator = np.random.default_rng(seed)
    route = _route(count * step_s, generator)
    times = np.arange(0.0, count * step_s, _SAMPLE_S)
    speed, acceleration = _sum(route.speed_steps, 0.0, times)
    heading, turning = _sum(route.heading_steps, base[5], times)
    height, slope = _road(_integral(speed), generator)
    local = Local(*base[:3])
    velocity = np.stack([speed * np.sin(heading), speed * np.cos(heading), speed * slope], axis=1)
    offsets = _over_ground(local, velocity)
    offsets[:, 2] = height
    angles = np.stack(
        [-_LEAN * speed * turning, np.arctan(slope) + _NOD * acceleration, heading - base[5]],
        axis=1,
    )
    still = tuple(
        (math.ceil(begin / step_s), math.floor(end / step_s)) for begin, end in route.stops
    )
    grid = Grid(count, step_s, still)
    coefficients = np.stack(
        [_fitted(grid, times, column) for column in (*offsets.T, *angles.T)], axis=1
    )
    coefficients[:, :3] = local.places(coefficients[:, :3])
    coefficients -= coefficients[0]
    return trajectory_of(
        Path(step_ns, base, coefficients), notes=_route_notes(route, speed, heading)
    )


def _fitted(grid: Grid, times: Floats, values: Floats) -> Floats:
    """Return the spline that best fits the values."""
    fit = Fit(grid, density=1e3)
    fit.add(Observations(times / grid.step_s, values, np.full_like(times, 1e-4)))
    return fit.solve()


def _route_notes(route: _Route, speed: Floats, heading: Floats) -> tuple[str, ...]:
    kilometres = _integral(speed)[-1] / 1000
    return (
        f"drives {kilometres:.1f} km at up to {speed.max():.1f} m/s, "
        f"{len(route.heading_steps)} turns and bends, {len(route.stops) - 1} stops",
    )
