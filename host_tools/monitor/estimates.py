"""The estimator, as the navigation computer reports it: a page of the monitor.

Source, gyro and accelerometer of the estimator's messages are another one each second, so the page
keeps what it has seen of each.
"""

from __future__ import annotations

from collections.abc import Iterator

from rrins.dbc.codec import load
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.plot import plot
from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.wording import NOTHING, age_words, clipped

_STATUS, _SOURCE, _AIDING = "ESTIMATOR_STATUS", "ESTIMATOR_SOURCE", "AIDING_STATUS"
_POSITION, _INTEGRITY = "ESTIMATOR_POSITION", "INTEGRITY"
_BOUNDS = ("horizontal", "vertical", "heading")
_DOUBTS = (
    ("suspected", "a fault is suspected"),
    ("unmonitored", "not all sensors are compared"),
    ("refusing", "an aid is refused"),
)
_SIGMAS = (
    ("attitude", "ESTIMATOR_ATTITUDE", "″", "{:.1f}"),
    ("velocity", "ESTIMATOR_VELOCITY", " m/s", "{:.4f}"),
    ("position", _POSITION, " m", "{:.2f}"),
)
_SENSORS = (
    ("gyro", "ESTIMATOR_GYRO", "°/h", "{:+.4f}"),
    ("accelerometer", "ESTIMATOR_ACCELEROMETER", "µg", "{:+.2f}"),
)
_KEYS = {
    "attitude": "attitude_arcsec",
    "velocity": "velocity_mps",
    "position": "position_m",
    "gyro": "dph",
    "accelerometer": "ug",
}


class Estimates:
    """Reports of each source and each sensor."""

    def __init__(self) -> None:
        self._sources: dict[int, tuple[int, int, float]] = {}  # used, rejected, NIS
        self._biases: dict[tuple[str, int], tuple[float, float]] = {}  # bias, σ
        self._names = load().choices(_SOURCE, "source")

    def note(self, state: BusState) -> None:
        """Keep what the last messages say."""
        if state.has_values(_SOURCE):
            used, rejected = (int(state.value(_SOURCE, name) or 0) for name in ("used", "rejected"))
            nis = state.value(_SOURCE, "nis") or 0.0
            self._sources[int(state.value(_SOURCE, "source") or 0)] = used, rejected, nis
        for _, message, _, _ in _SENSORS:
            if state.has_values(message):
                sensor = int(state.value(message, "sensor") or 0)
                bias, sigma = (state.value(message, name) or 0.0 for name in ("bias", "bias_sigma"))
                self._biases[message, sensor] = bias, sigma

    def as_dict(self, state: BusState) -> JsonObject | None:
        """Return the same for JSON; None where the firmware reports nothing.

        Keys with a unit at their end are in that unit; `sources` and `sensors` are what was seen
        so far.
        """
        self.note(state)
        if not state.has_values(_STATUS):
            return None
        sigma = {}
        for what, message, _, _ in _SIGMAS:
            if state.has_values(message):
                sides = ("east", "north", "up")
                sigma[_KEYS[what]] = [state.value(message, f"{side}_sigma") for side in sides]
        sensors: JsonObject = {}
        for name, message, _, _ in _SENSORS:
            sensors[f"{name}s"] = {
                sensor: {f"bias_{_KEYS[name]}": bias, f"sigma_{_KEYS[name]}": spread}
                for (of, sensor), (bias, spread) in sorted(self._biases.items())
                if of == message
            }
        return {
            "aided_by": self._named(state, "aided_by"),
            "rejecting": self._named(state, "rejecting"),
            "sigma": sigma,
            "sources": {
                self._names.get(number, str(number)).lower(): {
                    "used": used,
                    "rejected": rejected,
                    "nis": nis,
                }
                for number, (used, rejected, nis) in sorted(self._sources.items())
            },
            "aiding": _aiding(state),
            "integrity": _integrity(state),
            "sensors": sensors,
        }

    def _named(self, state: BusState, signal: str) -> list[str]:
        bits = int(state.value(_STATUS, signal) or 0)
        return [name.lower() for number, name in sorted(self._names.items()) if bits >> number & 1]

    def page(self, state: BusState, level: int, width: int) -> str:
        """Return the page; `level` is the time span of its plots."""
        self.note(state)
        lines = ["ESTIMATOR"]
        if not state.has_values(_STATUS):
            lines.append("  The firmware does not report any: it runs none, or not yet.")
            return "\n".join(clipped(line, width) for line in lines)
        status = state.message(_STATUS)
        if status is not None and status.is_silent:
            lines.append(f"  SILENT for {age_words(status.age_s)}")
        lines += [*_sigma_lines(state), *_integrity_lines(state), *self._source_lines(state)]
        lines += [*_receiver_lines(state), *self._sensor_lines()]
        for side in ("east_sigma", "north_sigma"):
            lines += ["", *plot(state, _POSITION, side, level, width).plain.splitlines()]
        return "\n".join(clipped(line, width) for line in lines)

    def _source_lines(self, state: BusState) -> Iterator[str]:
        for title, signal in (("aided by", "aided_by"), ("rejecting", "rejecting")):
            named = [_words(name) for name in self._named(state, signal)]
            yield f"  {title:<14}  {', '.join(named) or 'nothing'}"
        for number, (used, rejected, nis) in sorted(self._sources.items()):
            if used or rejected:
                name = _words(self._names.get(number, str(number)))
                yield f"  {name:<14}  {used} used, {rejected} rejected, NIS {nis:.2f}"

    def _sensor_lines(self) -> Iterator[str]:
        for name, message, unit, form in _SENSORS:
            for (of, sensor), (bias, sigma) in sorted(self._biases.items()):
                if of == message:
                    spread = form.replace("+", "").format(sigma)
                    yield f"  {f'{name} {sensor}':<16}{form.format(bias)} ± {spread} {unit}"


def _words(name: str) -> str:
    return name.lower().replace("_", " ").replace("gnss", "GNSS")


def _sigma_lines(state: BusState) -> Iterator[str]:
    for what, message, unit, form in _SIGMAS:
        if state.has_values(message):
            parts = (
                f"{side} {form.format(state.value(message, f'{side}_sigma') or 0.0)}{unit}"
                for side in ("east", "north", "up")
            )
            yield f"  {f'σ {what}':<14}  {', '.join(parts)}"


def _receiver_lines(state: BusState) -> Iterator[str]:
    """Yield whether fixes and distances come, and how often they stopped."""
    if not state.has_values(_AIDING):
        return
    for source in ("gnss", "odometer"):
        there = state.text(_AIDING, source) or NOTHING
        if there == "NONE":
            continue
        age = state.value(_AIDING, f"{source}_age") or 0.0
        losses = int(state.value(_AIDING, f"{source}_losses") or 0)
        yield f"  {_words(source):<14}  {there}, the latest {age:.1f} s old, lost {losses} times"
    if state.value(_AIDING, "standing"):
        yield "  the operator says that the vehicle stands"
    if state.value(_AIDING, "detected"):
        yield "  the sensors say that the vehicle stands"
    openings = int(state.value(_AIDING, "gate_openings") or 0)
    if openings:
        yield f"  took fixes again after it had rejected all for 120 s, {openings} times"


def _integrity_lines(state: BusState) -> Iterator[str]:
    """Yield the status of the integrity and the protection levels."""
    if not state.has_values(_INTEGRITY):
        return
    doubts = [text for name, text in _DOUBTS if state.value(_INTEGRITY, name)]
    status = (state.text(_INTEGRITY, "status") or NOTHING).lower().replace("_", " ")
    yield f"  {'integrity':<14}  {'; '.join([status, *doubts])}"
    values = (state.value(_INTEGRITY, f"{bound}_protection") or 0.0 for bound in _BOUNDS)
    level, height, heading = values
    yield f"  {'error below':<14}  {level:.1f} m, height {height:.1f} m, heading {heading:.2f}°"


def _integrity(state: BusState) -> JsonObject | None:
    """Return the status and the protection levels, by INTEGRITY; None without one."""
    if not state.has_values(_INTEGRITY):
        return None
    found: JsonObject = {"status": state.text(_INTEGRITY, "status")}
    found |= {name: bool(state.value(_INTEGRITY, name)) for name, _ in _DOUBTS}
    for bound, unit in zip(_BOUNDS, ("m", "m", "deg"), strict=True):
        found[f"{bound}_protection_{unit}"] = state.value(_INTEGRITY, f"{bound}_protection")
    return found


def _aiding(state: BusState) -> JsonObject | None:
    """Return which sources come, by AIDING_STATUS; None without one."""
    if not state.has_values(_AIDING):
        return None
    found: JsonObject = {}
    for source in ("gnss", "odometer", "altimeter"):
        found[source] = {"state": state.text(_AIDING, source)}
    for source in ("gnss", "odometer"):
        found[source]["age_s"] = state.value(_AIDING, f"{source}_age")
        found[source]["losses"] = state.value(_AIDING, f"{source}_losses")
    for said in ("standing", "detected"):
        found[said] = bool(state.value(_AIDING, said))
    found["gate_openings"] = int(state.value(_AIDING, "gate_openings") or 0)
    return found
