"""Random cases: site, motion, sensors, aids and faults, drawn by one seeded generator."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from rrins.firmware_py.core.integrity.settings import LEAST_RATE
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_kinds import HardwareFault, Part
from rrins.host_tools.integrity.fmeda import rates
from rrins.host_tools.integrity.fmeda.rates import FailureMode
from rrins.host_tools.integrity.phases import instants
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario import scenario as scenarios
from rrins.host_tools.scenario.fault_tables import AnyFault
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.wire.fault_kinds import FaultKind

HEALTHY, GYRO, ACCELEROMETER = "healthy", "gyro", "accelerometer"
PAIR, COMMON, GNSS, ODOMETER, WIRE = "pair", "common", "gnss", "odometer", "wire"
TABLE, ALTIMETER = "table", "altimeter"

NO_RATE: Final = {GNSS: "gnss, no rate", COMMON: "common, no rate"}
"""Kinds of faults that a unit may assume never to happen: what its level contains is what shows."""

STRATA: Final = (
    HEALTHY,
    GYRO,
    ACCELEROMETER,
    PAIR,
    COMMON,
    GNSS,
    ODOMETER,
    WIRE,
    TABLE,
    ALTIMETER,
    *NO_RATE.values(),
)

DRAWN: Final = {
    HEALTHY: 0.16,
    GYRO: 0.20,
    ACCELEROMETER: 0.14,
    PAIR: 0.14,
    COMMON: 0.08,
    GNSS: 0.10,
    ODOMETER: 0.08,
    WIRE: 0.10,
}
"""How often each class of fault is drawn; what it counts for is `risk.hourly`."""

_APART: Final = (TABLE, ALTIMETER)
_APART_SHARE: Final = 1 / 3
"""Of the cases without another fault, and with that part: it fails."""

_PARTS: Final = {
    GYRO: (Part.GYRO,),
    ACCELEROMETER: (Part.ACCELEROMETER,),
    PAIR: (Part.GYRO, Part.ACCELEROMETER),
    COMMON: (Part.GYRO, Part.ACCELEROMETER),
    GNSS: (Part.GNSS, Part.GNSS_POSITION),
    ODOMETER: (Part.ODOMETER,),
    TABLE: (Part.AXIS,),
    ALTIMETER: (Part.ALTIMETER,),
}
_ALIKE: Final = ("bias", "ramp", "scale")
"""Effects that all sensors of a kind have alike, such as by temperature or a supply."""

_GRADES: Final = {
    "navigation": {"level_error_sigma_arcsec": 20, "heading_error_sigma_arcsec": 60},
    "prototype": {"level_error_sigma_arcsec": 20, "heading_error_sigma_arcsec": 120},
    "tactical": {"level_error_sigma_arcsec": 200, "heading_error_sigma_arcsec": 360},
}
"""Presets, and the attitude that such a unit is given."""

_PROTOTYPES: Final = 4  # sensors that its data sheet lists
_STATED_PER_H = 1e-7  # of a receiver whose faults are among those to cover
_LONGEST_S = 200.0
_JITTER_S = 20.0


@dataclass(frozen=True)
class Case:
    """A scenario with what fails in it."""

    number: int
    kind: str  #: class of its faults, of `STRATA`
    scenario: Scenario
    failing: frozenset[str]  #: sensors that fail by themselves, such as gyro_2

    @property
    def stratum(self) -> str:
        """Its kind; of another one where the unit assumes that such faults never happen."""
        settings = self.scenario.integrity
        rates = {GNSS: settings.gnss_faults_per_h, COMMON: settings.common_faults_per_h}
        return self.kind if rates.get(self.kind, LEAST_RATE) >= LEAST_RATE else NO_RATE[self.kind]

    @property
    def is_beyond(self) -> bool:
        """Whether the unit assumes that such faults never happen."""
        return self.stratum != self.kind

    @property
    def words(self) -> str:
        """The faults, for a line."""
        return "; ".join(map(_words, self.scenario.faults)) or "nothing"


def _words(fault: AnyFault) -> str:
    """Return the kind of a fault and the keys that it has."""
    given = fault.model_dump(exclude_unset=True)
    kind = given.pop("kind")
    values = (
        f"{key} {rounded(v, 4)}" if isinstance(v, float) else f"{key} {v}"
        for key, v in given.items()
    )
    return f"{kind}, {', '.join(values)}"


def draw(seed: int, number: int, base: Scenario | None = None) -> Case:
    """Return a case: the same for the same seed and number.

    Parameters
    ----------
    base : Scenario, optional
        Gives all but seed and faults; without it, all is drawn.

    Raises
    ------
    ScenarioError
        When the scenario cannot bound its error.
    """
    chance = random.Random(f"{seed} {number}")
    kind = chance.choices(list(DRAWN), list(DRAWN.values()))[0]
    table: JsonObject
    if base is None:
        table = _unit(chance, kind)
        if kind == GNSS:
            table["integrity"] = {"gnss_faults_per_h": chance.choice((0.0, _STATED_PER_H))}
    else:
        table = base.model_dump(exclude_unset=True) | {"faults": ()}
        kind = _possible(base, kind)
    table["seed"] = chance.randrange(1, 1 << 31)
    table["integrity"] = dict(table.get("integrity", {})) | {"enabled": True}
    table["estimator"] = dict(table.get("estimator", {})) | {"enabled": True}
    healthy = scenarios.parse(table, f"case {number}")
    for part in _APART:  # by a generator of its own: all else is drawn as before
        own = random.Random(f"{seed} {number} {part}")
        if kind == HEALTHY and _has(healthy, part) and own.random() < _APART_SHARE:
            kind, chance = part, own
    faults, failing = _faults(chance, kind, healthy)
    found = scenarios.parse(table | {"faults": faults}, f"case {number}")
    return Case(number, kind, found, frozenset(failing))


def _possible(base: Scenario, kind: str) -> str:
    """Return the kind, or another one where a scenario lacks the aid."""
    lacks = (kind == GNSS and base.gnss is None) or (kind == ODOMETER and base.odometer is None)
    return GYRO if lacks else kind


def _has(healthy: Scenario, part: str) -> bool:
    """Return whether a unit has a part, and uses it."""
    return healthy.mode == "rotating" if part == TABLE else healthy.altimeter is not None


def _log_uniform(chance: random.Random, least: float, most: float) -> float:
    return float(least * (most / least) ** chance.random())


def _unit(chance: random.Random, kind: str) -> JsonObject:
    """Return a scenario without faults that fits a kind of fault."""
    motion = "drive" if kind == ODOMETER else chance.choice(("standing", "drive", "drive", "ship"))
    geometry = chance.choices(list(_GEOMETRIES), list(_GEOMETRIES.values()))[0]
    grades = [
        name for name in _GRADES if len(GEOMETRIES[geometry]) == _PROTOTYPES or name != "prototype"
    ]
    grade = chance.choice(grades)
    duration_s = round(chance.uniform(300, 900))
    table: JsonObject = {
        "mode": chance.choice(("rotating", "rotating", "rotating", "strapdown")),
        "duration_s": duration_s,
        "sensors": grade,
        "rimu": {"geometry": geometry},
        "site": {
            "latitude_deg": chance.choice((1, -1)) * chance.uniform(0, 89),
            "longitude_deg": chance.uniform(-180, 180),
            "height_m": chance.uniform(0, 2000),
        },
        "body": {"heading_deg": chance.uniform(0, 360)},
        "turntable": {
            "non_orthogonality_arcsec": chance.choice((0.0, chance.uniform(-25, 25))),
            "wobble_arcsec": chance.choice((0.0, chance.uniform(0, 10))),
        },
        "firmware": {"initial_attitude": "given", **_GRADES[grade], "height_channel": "held"},
        "estimator": {"enabled": True},
    }
    {"standing": _stand, "drive": _drive, "ship": _sail}[motion](chance, table)
    if kind == GNSS or (kind != ODOMETER and chance.random() < 0.5) or chance.random() < 0.6:
        table["gnss"] = _receiver(chance, duration_s)
    if motion == "drive" and (kind == ODOMETER or chance.random() < 0.5):
        table["odometer"] = {
            "scale_error_ppm": chance.gauss(0, 2000),
            "noise_mps": 0.02,
            "mounting_heading_deg": chance.gauss(0, 0.5),
            "mounting_pitch_deg": chance.gauss(0, 0.3),
            "lever_arm_m": [-0.8, -1.2, -0.6],
        }
    return table


_GEOMETRIES: Final = {
    "tetrahedron": 0.55,
    "dodecahedron": 0.25,
    "cone": 0.1,
    "orthogonal-plus-one": 0.1,
}


def _stand(chance: random.Random, table: JsonObject) -> None:
    if table["sensors"] != "tactical" and chance.random() < 0.5:
        table["firmware"] = {
            "initial_attitude": "self-aligned",
            "alignment_s": round(chance.uniform(60, 300)),
            "height_channel": "held",
        }
    table["estimator"]["detects_standing"] = chance.random() < 0.5


def _drive(chance: random.Random, table: JsonObject) -> None:
    duration_s = max(table["duration_s"], 30)
    table["motion"] = {
        "kind": "drive",
        "duration_s": duration_s,
        "seed": chance.randrange(1, 1 << 31),
    }
    weather = random.Random(table["motion"]["seed"])  # apart: all else is drawn as before
    table["altimeter"] = {
        "noise_m": 0.5,
        "bias_m": weather.gauss(0, 10),
        "random_walk_m_per_sqrt_h": 1.0,
    }
    table["firmware"]["height_channel"] = chance.choice(("damped", "free"))


def _sail(chance: random.Random, table: JsonObject) -> None:
    table["motion"] = {
        "kind": "sway",
        "seed": chance.randrange(1, 1 << 31),
        "wave_height_m": chance.uniform(0.3, 3.0),
        "wave_period_s": chance.uniform(6, 12),
        "wave_from_deg": chance.uniform(0, 360),
        "roll_period_s": chance.uniform(7, 15),
    }
    if table["sensors"] == "tactical" or chance.random() < 0.5:
        return  # the sea builds up once it navigates
    table["motion"] |= {"begins_s": -200, "wave_height_m": chance.uniform(0.3, 1.0)}
    table["firmware"] = {
        "initial_attitude": "self-aligned-swaying",
        "alignment_s": 120,
        "height_channel": "held",
    }
    table["estimator"]["fine_alignment_s"] = 300
    if chance.random() < 0.5:  # moored, says the operator
        table["zero_velocity"] = [{"at_s": 1, "for_s": 2000, "velocity_sigma_mps": 0.2}]


def _receiver(chance: random.Random, duration_s: int) -> JsonObject:
    receiver: JsonObject = {
        "position_noise_m": chance.uniform(0.5, 3.0),
        "velocity_noise_mps": chance.uniform(0.03, 0.1),
    }
    if chance.random() < 0.3:
        receiver["position_correlated_noise_m"] = chance.uniform(0.5, 2.0)
    if chance.random() < 0.5:
        at_s = chance.uniform(0.2, 0.7) * duration_s
        receiver["outages"] = [{"at_s": at_s, "for_s": _log_uniform(chance, 10, 200)}]
    return receiver


def _faults(
    chance: random.Random, kind: str, healthy: Scenario
) -> tuple[list[JsonObject], set[str]]:
    """Return the faults of a kind, and the sensors that fail by themselves."""
    if kind == HEALTHY:
        return [], set()
    rate_hz = healthy.rate_hz
    epoch = chance.choice(list(instants(healthy).values()))
    last_s = (healthy.epochs - 1) / rate_hz
    at_s = min(epoch / rate_hz + chance.uniform(0, _JITTER_S), last_s)
    if kind == WIRE:
        return _of_wire(chance, healthy, at_s)
    part = chance.choice(_PARTS[kind])
    if kind == PAIR:
        other = chance.choice((part, chance.choice(_PARTS[PAIR])))
        later_s = chance.choice((0.0, chance.uniform(0, 60)))
        first, name = _of_hardware(chance, part, healthy, at_s)
        second, another = _of_hardware(chance, other, healthy, min(at_s + later_s, last_s), name)
        return [first, second], {name, another}
    fault, name = _of_hardware(chance, part, healthy, at_s)
    if kind == COMMON:
        alike = {f"{part.name.lower()}_{word}" for word in _ALIKE}
        modes = [mode for mode in _modes(part) if mode.fault.word in alike]
        fault = _timed(chance, at_s) | _sized(chance.choice(modes), chance)
        return [fault], set()
    return [fault], {name} if part in (Part.GYRO, Part.ACCELEROMETER) else set()


@cache
def _modes(part: Part) -> tuple[FailureMode, ...]:
    """Return the ways in which a part fails, as in the example of the FMEDA."""
    return tuple(mode for mode in rates.load().modes if mode.fault.part is part)


def _timed(chance: random.Random, at_s: float, can_come_and_go: bool = False) -> JsonObject:
    found: JsonObject = {"at_s": at_s}
    if chance.random() < 0.4:
        found["for_s"] = _log_uniform(chance, 1, _LONGEST_S)
    if can_come_and_go and chance.random() < 0.15:
        found |= {"period_s": chance.uniform(1, 30), "duty": chance.uniform(0.1, 0.9)}
    return found


def _sized(mode: FailureMode, chance: random.Random) -> JsonObject:
    found: JsonObject = {"kind": mode.fault.word}
    if mode.fault.parameter is not None:
        found[mode.fault.parameter.key] = mode.draw(chance)
    return found


def _of_hardware(
    chance: random.Random, part: Part, healthy: Scenario, at_s: float, but: str = ""
) -> tuple[JsonObject, str]:
    """Return a fault of a part, and the name of the sensor; another one than `but`."""
    fault = _sized(chance.choice(_modes(part)), chance) | _timed(chance, at_s, True)
    target = HardwareFault[fault["kind"].upper()].target
    if part not in (Part.GYRO, Part.ACCELEROMETER):
        if target is not None:
            fault[target.key] = chance.choice(target.names)
        return fault, ""
    count = len(healthy.rimu.gyros if part is Part.GYRO else healthy.rimu.accelerometers)
    names = {k: f"{part.name.lower()}_{k}" for k in range(1, count + 1)}
    sensor = chance.choice([k for k, name in names.items() if name != but])
    return fault | {"sensor": sensor}, names[sensor]


def _of_wire(
    chance: random.Random, healthy: Scenario, at_s: float
) -> tuple[list[JsonObject], set[str]]:
    """Return a disturbance of the bus, and the sensors whose frames alone it spoils."""
    kinds = (FaultKind.DROP, FaultKind.CORRUPT, FaultKind.STALE, FaultKind.SILENCE)
    kind = chance.choice((FaultKind.DROP, *kinds))
    fault: dict[str, Any] = {"kind": kind.word, "at_s": at_s}
    failing = set[str]()
    if kind is FaultKind.SILENCE:
        fault |= {"node": "hardware", "for_s": _log_uniform(chance, 0.01, 1.0)}
        return [fault], failing
    fault["probability"] = _log_uniform(chance, 0.01, 0.6)
    if kind is FaultKind.STALE or chance.random() < 0.3:
        sensor = chance.randint(1, len(healthy.rimu.gyros))
        fault |= {"message": f"SENSOR_{sensor}", "probability": chance.choice((1.0, 0.93, 0.5))}
        failing = {f"gyro_{sensor}", f"accelerometer_{sensor}"}
    if chance.random() < 0.4:
        fault["for_s"] = _log_uniform(chance, 1, _LONGEST_S)
    return [fault], failing
