"""The header of the screen: bus, firmware, axes, navigation, fault counters, troubles."""

from __future__ import annotations

from datetime import UTC, datetime

from rich.text import Text

from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.vitals import AXES, AxisVitals, Vitals
from rrins.host_tools.monitor.wording import NOTHING, age_words, clipped, percent_words, rate_words

HEIGHT = 7
"""Lines of the header."""

_GAP = "  "
_UNIX_S = 1e9  # bus time above this is Unix time
_END_S = 253_402_300_800.0  # the year 10,000: no time of day above this
_QUIET_S = 1.0


def banner(bus: str, state: BusState, vitals: Vitals, troubles: list[str], width: int) -> Text:
    """Return the header, `HEIGHT` lines."""
    lines = [
        _bus_line(bus, state),
        _firmware_line(vitals),
        _axes_line(vitals),
        *_navigation_lines(vitals),
        _counters_line(vitals),
        _troubles_line(troubles, width),
    ]
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return Text("\n").join(lines)


def notices(state: BusState, is_frozen: bool) -> list[str]:
    """Return notices about the screen itself; none in normal operation."""
    found = []
    if is_frozen:
        found.append("FROZEN: press f to resume")
    if state.times.ended is not None:
        found.append(f"THE BUS HAS ENDED: {state.times.ended}")
    elif not state.frames:
        found.append("WAITING FOR FRAMES")
    elif state.times.quiet_s > _QUIET_S and not is_frozen:
        found.append(f"NO FRAMES for {age_words(state.times.quiet_s)} (wall clock)")
    if state.times.gaps:
        found.append(f"MISSED FRAMES: the monitor fell behind {state.times.gaps} times")
    if state.times.refused.frames:
        refused = state.times.refused
        found.append(f"{refused.frames} FRAMES NOT DELIVERED: {refused.line}")
    return found


def _line(*fields: tuple[str, str]) -> Text:
    """Return a line of labels and bold values."""
    text = Text(no_wrap=True)
    for label, value in fields:
        if text:
            text.append(_GAP)
        text.append(label)
        if label and value:
            text.append(" ")
        text.append(value, style="bold")
    return text


def time_words(time_s: float) -> str:
    """Return a bus time: seconds since power-on, or the UTC time of day of a Unix time."""
    if not _UNIX_S <= time_s < _END_S:
        return f"{time_s:.3f} s"
    return f"{datetime.fromtimestamp(time_s, UTC):%H:%M:%S} UTC"


def _bus_line(bus: str, state: BusState) -> Text:
    speed = state.times.speed
    fields = [("", bus), ("time", time_words(state.time_s))]
    if speed is not None:
        fields.append(("×", f"{speed:.{0 if speed >= 10 else 2}f}"))
    fields += [
        ("frames/s", rate_words(state.rate_hz)),
        ("load", percent_words(state.load)),
        ("peak", percent_words(state.peak_load)),
    ]
    return _line(*fields)


def _firmware_line(vitals: Vitals) -> Text:
    firmware = vitals.firmware
    if firmware is None:
        return _line(("mode", NOTHING))
    mode = firmware.mode if firmware.mode != "FAULT" else f"FAULT ({firmware.fault})"
    if firmware.is_silent:
        mode += f" {age_words(firmware.age_s)} ago"
    position = str(firmware.scheme_position) if firmware.scheme_position else NOTHING
    fields = [
        ("mode", mode),
        ("position", position),
        ("cycle", str(firmware.scheme_cycle)),
        ("sensors", str(firmware.usable_sensors)),
        ("computing", f"{firmware.load_percent:.1f} %"),
    ]
    if firmware.sync_lost:
        fields.append(("", "SYNC LOST"))
    return _line(*fields)


def _axis_words(axis: AxisVitals | None) -> str:
    if axis is None:
        return NOTHING
    words = f"{axis.angle_deg:.4f}° {axis.rate_dps:+.3f} °/s {axis.state}"
    if axis.is_silent:
        words += " SILENT"
    elif axis.follows is False:
        words += " NOT FOLLOWING"
    return words


def _axes_line(vitals: Vitals) -> Text:
    return _line(*((name, _axis_words(vitals.axes[name])) for name in AXES))


def _navigation_lines(vitals: Vitals) -> tuple[Text, Text]:
    navigation = vitals.navigation
    if navigation is None:
        return _line(("navigation", NOTHING)), _line(("attitude", NOTHING))
    east, north = navigation.velocity_east, navigation.velocity_north
    velocity = f"{east:+.3f} {north:+.3f} {navigation.velocity_up:+.3f} m/s"
    first = _line(
        ("lat", f"{navigation.latitude_deg:.7f}°"),
        ("lon", f"{navigation.longitude_deg:.7f}°"),
        ("h", f"{navigation.height:.2f} m"),
        ("v ENU", velocity),
    )
    second = [
        ("roll", f"{navigation.roll_deg:.3f}°"),
        ("pitch", f"{navigation.pitch_deg:.3f}°"),
        ("heading", f"{navigation.heading_deg:.3f}°"),
    ]
    if navigation.is_silent:
        second.append(("", "NAVIGATION IS NO LONGER SENT"))
    return first, _line(*second)


def _counters_line(vitals: Vitals) -> Text:
    if vitals.counters is None:
        return _line(("counted", NOTHING))
    fields = [("counted", "")]
    for name, counter in vitals.counters.items():
        grown = f" +{counter.recent}" if counter.recent > 0 else ""
        fields.append((name.partition("_")[0], f"{counter.count}{grown}"))
    return _line(*fields)


def _troubles_line(troubles: list[str], width: int) -> Text:
    if not troubles:
        return Text("troubles none")
    text = f"TROUBLES {len(troubles)}: {'; '.join(troubles)}"
    return Text(clipped(text, width), style="bold red")
