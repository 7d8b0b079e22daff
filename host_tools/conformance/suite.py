"""All checks in their order, and how they are run."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rrins.host_tools.conformance import (
    as_program,
    behaviour,
    clock,
    diagnostics,
    frame_by_frame,
    frames_in,
)
from rrins.host_tools.conformance.check import Check, Finding, NotApplicableError, Subject
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.programs.notices import LOGGER
from rrins.host_tools.testing.errors import BenchError

FIRST: Final = behaviour.start_up
"""If the program dies or stays silent here, the others are skipped."""

CHECKS: Final = (
    FIRST,
    behaviour.self_test,
    behaviour.modes,
    behaviour.commands,
    behaviour.shutdown,
    behaviour.power_cycles,
    as_program.set_up,
    as_program.ends,
    frames_in.wrong_crc,
    frames_in.late_frames,
    frames_in.stale_counter,
    frames_in.repeated_frames,
    frames_in.disagreeing_frames,
    frames_in.strange_frames,
    frames_in.gap_bridged,
    frames_in.gap_too_long,
    frames_in.three_sensors,
    frames_in.sync_lost,
    frames_in.overload,
    behaviour.axis_fault,
    behaviour.axis_silent,
    *frame_by_frame.SHORT,
    diagnostics.uds,
    diagnostics.uds_sessions,
    diagnostics.uds_security,
    diagnostics.uds_access,
    diagnostics.uds_reset,
    diagnostics.uds_trouble_codes,
    clock.clock_error,
    clock.stalls,
    clock.late_attach,
)
"""In the order in which they are tried."""

LONG: Final = (*CHECKS, *frame_by_frame.LONG)
"""All there are."""


def chosen(names: Sequence[str], is_long: bool = False) -> tuple[Check, ...]:
    """Return the checks of these names; without any all, those that take long if `is_long`.

    Raises
    ------
    RehearsalError
        If there is no such check.
    """
    known = {check.name: check for check in LONG}
    for name in names:
        if name not in known:
            raise RehearsalError(f"no check {name!r}: there are {', '.join(known)}")
    return tuple(known[name] for name in names) or (LONG if is_long else CHECKS)


def conform(program: str | None, checks: Sequence[Check] = CHECKS) -> Iterator[Finding]:
    """Try checks on a program; yield the result of each.

    Parameters
    ----------
    program : str or None
        Command line; None for the project's own firmware.
    checks : sequence of Check
    """
    hopeless = ""
    for check in checks:
        if hopeless:
            yield Finding(check, "skipped", f"not tried: {hopeless}", 0.0)
            continue
        finding, is_dead = _try(check, program)
        if is_dead and check is FIRST:
            hopeless = finding.line
        yield finding


def _try(check: Check, program: str | None) -> tuple[Finding, bool]:
    """Try a check; return the result, and whether the program itself failed."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rrins-conform-") as folder, _unheard_bus():
        try:
            with Subject(program, Path(folder)) as subject:
                check.run(subject)
        except (AssertionError, BenchError) as error:
            is_dead = isinstance(error, BenchError)
            return Finding(check, "failed", str(error), time.monotonic() - begin), is_dead
        except NotApplicableError as error:
            return Finding(check, "skipped", str(error), time.monotonic() - begin), False
    return Finding(check, "passed", "", time.monotonic() - begin), False


@contextmanager
def _unheard_bus() -> Iterator[None]:
    """Leave unheard what the bus says of a program that goes: the finding says what matters."""
    logger = logging.getLogger(LOGGER)
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
