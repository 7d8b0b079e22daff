"""Redundant sensors, as the navigation computer reports them: values, troubles, and a page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rrins.host_tools.monitor.plot import plot
from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.wording import NOTHING, age_words, clipped
from rrins.host_tools.monitor.words import FOUND_BY, drift_words, extent_words, parity_words

MESSAGES = {"gyros": "GYRO_REDUNDANCY", "accelerometers": "ACCELEROMETER_REDUNDANCY"}
"""Message of each kind of sensors."""

READMISSION = "READMISSION_STATUS"

_BAR = 40  # characters of a bar
_FULL = 2.0  # parity over threshold at its end
_REPORT_EVERY = 25  # frames of FIRMWARE_STATUS, ten a second: two reports and a half


@dataclass(frozen=True)
class RedundancyVitals:
    """Redundancy of one kind of sensors; sensors count from 1, None for none."""

    parity_ratio: float
    """The largest parity of the last second over its threshold; above 1 is an alarm."""
    largest_ratio: float
    """The largest since the start."""
    window_s: int
    """Window of the parity."""
    alarm: bool
    points_at: int | None
    """The sensor that the parity points at most, however small it is."""
    suspect: int | None
    """The same in an alarm; without one there is no suspect."""
    excluded: tuple[int, ...]
    isolated: int | None
    """Left out last."""
    how: str | None
    """How it was found."""
    redundancy_left: bool
    standing: bool
    repairing: bool
    drift: str | None
    """How far the calibration has drifted: a value of the DBC."""
    age_s: float
    is_silent: bool


@dataclass(frozen=True)
class ReadmissionVitals:
    """A sensor that the operator wants back."""

    state: str
    kind: str
    sensor: int
    anew: bool
    refusal: str | None
    passed_s: int
    test_s: int
    parity_ratio: float
    """The largest of the test over its threshold."""


def redundancy_of(state: BusState, kind: str) -> RedundancyVitals | None:
    """Return what was last reported of a kind, `gyros` or `accelerometers`; None for nothing."""
    name = MESSAGES[kind]
    message = state.message(name)
    if message is None or not state.has_values(name):
        return None

    def number(signal: str) -> int:
        return int(state.value(name, signal) or 0)

    ratio, points_at = state.signal(name, "parity_ratio"), number("suspect") or None
    return RedundancyVitals(
        parity_ratio=ratio.value or 0.0,
        largest_ratio=ratio.high or 0.0,
        window_s=1 << number("window_log2"),
        alarm=bool(number("alarm")),
        points_at=points_at,
        suspect=points_at if number("alarm") else None,
        excluded=tuple(k + 1 for k in range(16) if number("excluded") >> k & 1),
        isolated=number("isolated") or None,
        how=state.text(name, "how") if number("how") else None,
        redundancy_left=bool(number("redundant")),
        standing=bool(number("standing")),
        repairing=bool(number("repairing")),
        drift=state.text(name, "drift") if number("drift") else None,
        age_s=message.age_s,
        is_silent=message.is_silent,
    )


def readmission_of(state: BusState) -> ReadmissionVitals | None:
    """Return what has become of the last order to readmit a sensor; None without one."""
    if not state.has_values(READMISSION):
        return None

    def number(signal: str) -> float:
        return state.value(READMISSION, signal) or 0.0

    return ReadmissionVitals(
        state=state.text(READMISSION, "state") or "",
        kind=(state.text(READMISSION, "kind") or "").lower(),
        sensor=int(number("sensor")),
        anew=bool(number("anew")),
        refusal=state.text(READMISSION, "refusal") if number("refusal") else None,
        passed_s=int(number("passed_s")),
        test_s=int(number("test_s")),
        parity_ratio=number("parity_ratio"),
    )


def redundancy_troubles(kinds: dict[str, RedundancyVitals | None]) -> Iterator[str]:
    """Yield what is wrong with redundant sensors."""
    for name, found in kinds.items():
        if found is None:
            continue
        one = name.removesuffix("s")
        if found.alarm:
            yield f"the {name} disagree: one of them fails, and it is not known which"
        for sensor in found.excluded:
            is_last = sensor == found.isolated and found.how
            yield f"{one} {sensor} is left out" + (f", found {_how(found)}" if is_last else "")
        if found.excluded and not found.redundancy_left:
            yield f"no redundancy is left among the {name}"
        if found.drift:
            yield drift_words(one, found.drift)


def _how(found: RedundancyVitals) -> str:
    """Return how the sensor was found that was left out last."""
    how = found.how or NOTHING
    return f"by {FOUND_BY.get(how, how)}"


def redundancy_words(
    kinds: dict[str, RedundancyVitals | None], readmission: ReadmissionVitals | None
) -> list[str]:
    """Return a line for each kind that is reported, and one for a readmission."""
    lines = [
        f"{name:<14}  {_kind_words(found)}" for name, found in kinds.items() if found is not None
    ]
    if readmission is not None:
        lines.append(f"{'readmission':<14}  {_readmission_words(readmission)}")
    return lines


def _kind_words(found: RedundancyVitals) -> str:
    left_out = ", ".join(map(str, found.excluded)) or "none"
    words = f"left out {left_out}  redundancy left {'yes' if found.redundancy_left else 'NO'}"
    if found.redundancy_left:
        words = (
            f"parity/threshold {parity_words(found.parity_ratio)} in {found.window_s} s  {words}"
        )
    if found.alarm:
        words += f"  ALARM, suspect {found.suspect or NOTHING}"
    if found.drift:
        words += f"  calibration DRIFTED {extent_words(found.drift)}"
    if found.repairing:
        words += "  repairing the navigation"
    if found.is_silent:
        words += f"  SILENT for {age_words(found.age_s)}"
    return words


def _readmission_words(found: ReadmissionVitals) -> str:
    outcome = found.state if found.refusal is None else f"{found.state} ({found.refusal})"
    words = f"{found.kind} {found.sensor} {outcome}, compared for {found.passed_s} of "
    words += f"{found.test_s} s, parity/threshold up to {parity_words(found.parity_ratio)}"
    return f"{words}, constants learned anew" if found.anew else words


def redundancy_page(state: BusState, level: int, width: int) -> str:
    """Return the page on redundancy; `level` is the time span of its plots."""
    lines, plots = ["REDUNDANCY"], []
    for name, message in MESSAGES.items():
        found = redundancy_of(state, name)
        if found is None:
            continue
        lines += [name.upper(), *_details(found)]
        if found.redundancy_left:
            plotted = plot(state, message, "parity_ratio", level, width)
            plots += ["", *plotted.plain.splitlines()]
    if len(lines) == 1:
        lines.append(f"  {_why_nothing(state)}")
    readmission = readmission_of(state)
    if readmission is not None:
        lines.append(f"READMISSION  {_readmission_words(readmission)}")
    lines += plots
    return "\n".join(clipped(line, width) for line in lines)


def _why_nothing(state: BusState) -> str:
    firmware = state.message("FIRMWARE_STATUS")
    if firmware is None:
        return "Nothing of the firmware was on the bus yet."
    if firmware.count < _REPORT_EVERY:
        return "No report yet: one comes each second where the firmware compares its sensors."
    return "The firmware does not report any: it compares no sensors."


def _details(found: RedundancyVitals) -> Iterator[str]:
    left_out = ", ".join(map(str, found.excluded)) or "none"
    if found.redundancy_left:
        yield f"  parity/threshold  {_bar(found.parity_ratio)} {parity_words(found.parity_ratio)}"
        yield f"  largest so far    {_bar(found.largest_ratio)} {parity_words(found.largest_ratio)}"
        yield f"  window            {found.window_s} s"
        if found.alarm:
            yield f"  suspect           {found.suspect or NOTHING}  ALARM"
        else:
            yield "  suspect           none: all agree"
    last = f" (the last, {found.isolated}, {_how(found)})" if found.how else ""
    yield f"  left out          {left_out}{last}"
    left = "yes" if found.redundancy_left else "NO: a fault of another would not show"
    yield f"  redundancy left   {left}"
    against = "encoders, Earth rate and gravity, too" if found.standing else "the others only"
    yield f"  compared with     {against}"
    if found.drift:
        yield f"  calibration       DRIFTED: {extent_words(found.drift)}, if it is one sensor"
    if found.repairing:
        yield "  the navigation is being repaired from before the fault"
    if found.is_silent:
        yield f"  SILENT for {age_words(found.age_s)}"


def _bar(ratio: float) -> str:
    """Return a bar whose middle, a vertical line, is the threshold."""
    filled = min(_BAR, round(_BAR * ratio / _FULL))
    bar = "#" * filled + "." * (_BAR - filled)
    middle = round(_BAR / _FULL)
    return f"{bar[:middle]}|{bar[middle:]}"
