"""All checks in their order, and how they are run."""

from __future__ import annotations

import functools
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from rrins.host_tools.conformance import behaviour, clock, diagnostics, frames_in
from rrins.host_tools.conformance.check import Check, Finding, NotApplicableError, Subject
from rrins.host_tools.conformance.navigation import DURATION_S, LIMIT_M, SCENARIOS, navigation
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.testing.errors import BenchError

FIRST: Final = "start-up"
"""Without it no other check is worth its time."""


def _navigation(name: str) -> Check:
    return Check(
        f"navigation-{name.replace('_', '-')}",
        f"Over {DURATION_S:g} s of `{name}` the position is within {LIMIT_M:g} m of the reference.",
        "firmware.md#strapdown",
        functools.partial(navigation, name=name),
    )


CHECKS: Final = (
    Check(
        FIRST,
        "Heartbeat and status come at their cycle times; STANDBY after a self-test of 0.5 s.",
        "firmware.md#modes",
        behaviour.start_up,
    ),
    Check(
        "self-test",
        "A sensor that is absent ends the self-test in FAULT (SELF_TEST_FAILED) after 10 s; a "
        "request for STANDBY begins it anew.",
        "firmware.md#modes",
        behaviour.self_test,
    ),
    Check(
        "modes",
        "Every mode is reached on request; ALIGN alone waits; no NAV_ frames but in navigation.",
        "firmware.md#modes",
        behaviour.modes,
    ),
    Check(
        "commands",
        "A command for each axis in every epoch, with the epoch as its counter.",
        "firmware.md#frames-out",
        behaviour.commands,
    ),
    Check(
        "shutdown",
        "SHUTDOWN switches both axes OFF, and the program ends with status 0.",
        "firmware.md#modes",
        behaviour.shutdown,
    ),
    Check(
        "wrong-crc",
        "A frame with a wrong CRC is counted and never used.",
        "firmware.md#frames-in",
        frames_in.wrong_crc,
    ),
    Check(
        "late-frames",
        "A frame of another epoch is counted and never used.",
        "firmware.md#frames-in",
        frames_in.late_frames,
    ),
    Check(
        "stale-counter",
        "A frame that repeats an earlier counter is counted and never used.",
        "firmware.md#frames-in",
        frames_in.stale_counter,
    ),
    Check(
        "repeated-frames",
        "A second frame of its message in the epoch is counted and never used.",
        "firmware.md#frames-in",
        frames_in.repeated_frames,
    ),
    Check(
        "disagreeing-frames",
        "Of two frames that disagree about an epoch neither is used.",
        "firmware.md#two-senders-of-one-message",
        frames_in.disagreeing_frames,
    ),
    Check(
        "strange-frames",
        "Unknown, extended and remote frames are ignored; a short one counts as a wrong CRC.",
        "firmware.md#frames-in",
        frames_in.strange_frames,
    ),
    Check(
        "gap-bridged",
        "A gap in the sensor data up to `bridge_s` is bridged, and its epochs are counted.",
        "firmware.md#fusion",
        frames_in.gap_bridged,
    ),
    Check(
        "gap-too-long",
        "A longer gap ends navigation in FAULT (SENSORS_LOST), which sends no NAV_ frames.",
        "firmware.md#fusion",
        frames_in.gap_too_long,
    ),
    Check(
        "three-sensors",
        "With three of four sensors navigation goes on.",
        "firmware.md#fusion",
        frames_in.three_sensors,
    ),
    Check(
        "sync-lost",
        "`sync_lost` after 10 epochs without SYNC, cleared by the next; navigation goes on.",
        "firmware.md#clock",
        frames_in.sync_lost,
    ),
    Check(
        "overload",
        "A second of 200 strange frames an epoch does navigation no harm.",
        "firmware.md#frames-in",
        frames_in.overload,
    ),
    Check(
        "axis-fault",
        "An axis that does not follow is told and both hold; the rotation is tried again.",
        "firmware.md#rotation-scheme",
        behaviour.axis_fault,
    ),
    Check(
        "axis-silent",
        "An axis that is silent for longer than `axis_silence_s` does not follow.",
        "firmware.md#rotation-scheme",
        behaviour.axis_silent,
    ),
    Check(
        "uds",
        "Where there is UDS: TesterPresent and the default session are answered, what cannot be by "
        "the negative response of ISO 14229-1, functional requests of that kind not at all.",
        "diagnostics.md#sessions-and-security",
        diagnostics.basics,
    ),
    Check(
        "uds-sessions",
        "A session other than the default one ends 5 s after the last request; TesterPresent keeps "
        "it. SecurityAccess is refused in the default session.",
        "diagnostics.md#sessions-and-security",
        diagnostics.sessions,
    ),
    Check(
        "uds-security",
        "A key without a seed and a wrong key are refused, and after the third there is no seed.",
        "diagnostics.md#sessions-and-security",
        diagnostics.security,
    ),
    Check(
        "uds-trouble-codes",
        "The loss of SYNC makes a trouble code's test fail; clearing removes the code once it is "
        "over.",
        "diagnostics.md#trouble-codes",
        diagnostics.trouble_codes,
    ),
    Check(
        "clock-error",
        f"In real time a clock error of {clock.ERROR_PPM:g} ppm is learned, and commands are in "
        "time.",
        "firmware.md#clock",
        clock.clock_error,
    ),
    *(_navigation(name) for name in SCENARIOS),
)
"""In the order in which they are tried."""


def chosen(names: Sequence[str]) -> tuple[Check, ...]:
    """Return the checks of these names, all without any.

    Raises
    ------
    RehearsalError
        If there is no such check.
    """
    known = {check.name: check for check in CHECKS}
    for name in names:
        if name not in known:
            raise RehearsalError(f"no check {name!r}: there are {', '.join(known)}")
    return tuple(known[name] for name in names) or CHECKS


def conform(
    program: str | None,
    checks: Sequence[Check] = CHECKS,
    on_check: Callable[[Check], None] = lambda check: None,
) -> Iterator[Finding]:
    """Try checks on a program; yield what came of each.

    A program that does not get through `FIRST` because it is dead or silent is not tried further.

    Parameters
    ----------
    program : str or None
        Command line; None for the project's own firmware.
    checks : sequence of Check
    on_check : callable
        Called before each.
    """
    hopeless = ""
    for check in checks:
        if hopeless:
            yield Finding(check, "skipped", f"not tried: {hopeless}", 0.0)
            continue
        on_check(check)
        finding, is_dead = _try(check, program)
        if is_dead and check.name == FIRST:
            hopeless = finding.line
        yield finding


def _try(check: Check, program: str | None) -> tuple[Finding, bool]:
    """Try a check; return what came of it, and whether the program itself failed."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rrins-conform-") as folder:
        subject = Subject(program, Path(folder))
        try:
            with subject:
                check.run(subject)
        except AssertionError as error:
            return Finding(check, "failed", str(error), time.monotonic() - begin), False
        except NotApplicableError as error:
            return Finding(check, "skipped", str(error), time.monotonic() - begin), False
        except BenchError as error:
            return Finding(check, "failed", str(error), time.monotonic() - begin), True
    return Finding(check, "passed", "", time.monotonic() - begin), False
