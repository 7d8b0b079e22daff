"""Serial settings as command-line options, for a firmware process that a rehearsal starts."""

from __future__ import annotations

from rrins.firmware_py.serial.settings import SerialSettings


def arguments_of(settings: SerialSettings) -> tuple[str, ...]:
    """Return the command-line options for these settings."""
    arguments: list[str] = []
    if settings.nmea is not None:
        arguments += ["--nmea", settings.nmea.text, "--nmea-rate", str(settings.nmea_rate_hz)]
        arguments += ["--nmea-sentences", ",".join(settings.nmea_sentences)]
        arguments += ["--utc", settings.utc.isoformat()]
    if settings.console is not None:
        arguments += ["--console", settings.console.text]
    return tuple(arguments)
