"""The identifier `calibration_status` for a person: date, age, temperature, drift since then."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping

from rrins.firmware_py.core.records.calibration_records import DriftState
from rrins.firmware_py.diagnostics.codecs import Value
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import rounded

_DAY_S = 86_400.0
_KINDS = {"gyros": "gyro", "accelerometers": "accelerometer"}
_AXES = "xyz"


def age_days(date_utc_s: int) -> float:
    """Return how old a calibration is by this computer's clock; the firmware has none."""
    now = datetime.datetime.now(datetime.UTC).timestamp()
    return round((now - date_utc_s) / _DAY_S, 1)


def date_of(date_utc_s: int) -> str | None:
    """Return the date, as 2026-11-23T08:05:00Z; None where it is not known."""
    if not date_utc_s:
        return None
    date = datetime.datetime.fromtimestamp(date_utc_s, datetime.UTC)
    return f"{date:%Y-%m-%dT%H:%M:%SZ}"


def status_of(values: Mapping[str, Value]) -> JsonObject:
    """Return date, age, temperature and drift; null where a value is not known.

    Parameters
    ----------
    values : dict
        Of the identifier.
    """
    seconds = int(_number(values["date_utc_s"]))
    status: JsonObject = {
        "date_utc": date_of(seconds),
        "age_days": age_days(seconds) if seconds else None,
        "temperature_c": values["temperature_c"] if values["temperature_known"] else None,
    }
    for name, one in _KINDS.items():
        state = DriftState(int(_number(values[f"{one}_drift"])))
        is_compared = state != DriftState.NOT_COMPARED
        told = int(_number(values[f"{one}_told"]))
        status[name] = {
            "state": state.name.lower(),
            "told": "".join(axis for k, axis in enumerate(_AXES) if told >> k & 1),
            "drift_ppm": _rounded(values[f"{one}_drift_ppm"]) if is_compared else None,
            "distance_sigma": _rounded(values[f"{one}_drift_sigma"]) if is_compared else None,
            "limit_sigma": _rounded(values[f"{one}_limit_sigma"]) if is_compared else None,
        }
    return status


def _number(value: Value) -> int | float:
    assert isinstance(value, int | float)
    return value


def _rounded(value: Value) -> float:
    return round(_number(value), 2)


def origin_words(status: JsonObject) -> str:
    """Return when, how long ago and how warm, in words."""
    words = [] if status["date_utc"] is None else [f"on {status['date_utc'][:10]}"]
    if status["age_days"] is not None:
        words.append(f"{status['age_days']:g} days ago")
    if status["temperature_c"] is not None:
        words.append(f"at {status['temperature_c']:g} °C")
    return ", ".join(words)


def drift_words(name: str, kind: JsonObject) -> str:
    """Return whether the constants of a kind are still those calibrated, in words."""
    if kind["state"] == "not_compared":
        return f"{name}: not compared with their calibration"
    if kind["state"] == "learning":
        return f"{name}: the parity tells nothing yet"
    distance, limit = rounded(kind["distance_sigma"]), rounded(kind["limit_sigma"])
    words = f"{distance} σ from their calibration, {limit} allowed"
    words = f"{name}: {words}, seen along {', '.join(kind['told'])}"
    if kind["state"] == "drifted":
        words += f"; drifted by {rounded(kind['drift_ppm'])} ppm if it is one of them"
    return words


def lines(status: JsonObject) -> Iterator[str]:
    """Yield date, age and temperature, and the drift of each kind, a line each."""
    yield f"calibrated {origin_words(status) or 'at an unknown date'}"
    for name in _KINDS:
        yield drift_words(name, status[name])
