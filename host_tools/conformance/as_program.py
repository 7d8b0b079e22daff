"""Checks of the program itself: the set-up that it reads, and how it ends."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rrins.host_tools.conformance.check import SCENARIO, NotApplicableError, Subject, check
from rrins.host_tools.conformance.trial import BASE, PATIENCE_S
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.set_up.setup_file import setup_text
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.processes import OwnProgram
from rrins.host_tools.testing.recording import FrameRing
from rrins.host_tools.testing.scenarios import prepare_scenario
from rrins.host_tools.testing.virtual_time import LockstepExecution

_END_S: Final = 30.0  # patience with the machine
_RING: Final = 256  # frames; nothing here looks at them

_UNUSED: Final = ("gnss_interval_s",)  # where there is no receiver

GOOD: Final = ("a_key_of_tomorrow 1 2 3 4 5 6", "turn_rate_dps 0.5", "axis_acceleration_dps2 0.5")
"""Lines that every program has to accept."""


def _without(text: str, key: str) -> str:
    return re.sub(rf"^{key} .*\n", "", text, flags=re.MULTILINE)


def spoilt(text: str) -> Iterator[tuple[str, str]]:
    """Yield set-ups that are no set-ups, made of a good one, each behind what is wrong with it."""
    yield "that is empty", ""
    first = {line.split()[0]: line for line in reversed(text.splitlines())}
    for key, line in first.items():
        if key not in _UNUSED:
            yield f"without {key}", _without(text, key)
            yield f"with {line.split()[-1]}x in {key}", text.replace(line, f"{line}x", 1)
    for line in (
        *("rrins-setup 2", "rate_hz 0", "rate_hz 0.5", "turn_rate_dps 0.0"),
        "axis_acceleration_dps2 0.0",
        *("latitude_deg", "rate_hz", "initial_attitude", "turn inner", "turn middle 180.0"),
        *("gyro 0.0 0.0", "gyro 180.0 0.0 1.0 1.0", "accelerometer 0.0 0.0"),
    ):
        yield f"with '{line}'", text.replace(first[line.split()[0]], line, 1)
    for kind in ("gyro", "accelerometer"):
        yield f"of two {kind}s", re.sub(rf"(^{kind} .*\n)+", r"\1\1", text, flags=re.MULTILINE)


@dataclass(frozen=True)
class _Misled(Program):
    """A program with another set-up than its scenario's."""

    text: str = ""

    def write_setup(self, path: Path, scenario: Scenario) -> None:
        path.write_text(self.text, encoding="utf-8")


def _scenario(subject: Subject) -> Scenario:
    if subject.program is None:
        raise NotApplicableError("our own firmware reads a scenario, not a set-up")
    return prepare_scenario(SCENARIO, BASE, subject.folder / "set-up.toml", subject.folder)


@contextmanager
def _started(subject: Subject, scenario: Scenario, text: str) -> Iterator[LockstepExecution]:
    """Start the program with a set-up; yield it once it is on the bus."""
    assert subject.program is not None
    own = OwnProgram(_Misled(Program.parse(subject.program).words, text=text), scenario)
    file = subject.folder / "set-up.toml"
    stand = LockstepExecution(scenario, FrameRing(_RING), file, PATIENCE_S, own=own)
    try:
        yield stand
    finally:
        stand.close()


@check("own-firmware.md#the-set-up", "PRG-1 PRG-2")
def set_up(subject: Subject) -> None:
    """A set-up that is spoilt ends the program with a line and another status than 0.

    An unknown key is skipped, unless the program was built for one set-up and refuses all others.
    """
    scenario = _scenario(subject)

    def starts(what: str, text: str) -> bool:
        try:
            with _started(subject, scenario, text):
                return True
        except BenchError as error:
            _expect_refusal(str(error), f"with a set-up {what} ")
            return False

    good = setup_text(scenario)
    for what, text in spoilt(good):
        assert not starts(what, text), f"it starts with a set-up {what}"
    if starts("of another height", good.replace("height_m ", "height_m 1")):
        for line in GOOD:
            other = f"{_without(good, line.split()[0])}{line}\n"
            assert starts(f"with '{line}'", other), f"it refuses a set-up with '{line}'"


def _expect_refusal(said: str, when: str) -> None:
    status, _, reason = said.partition(" ended with status ")[2].partition(": ")
    assert status, when + said
    assert status != "0", f"{when}it ends with status 0"
    assert reason, f"{when}it does not say why it ends"


@check("own-firmware.md#how-a-program-is-called", "PRG-3 PRG-4")
def ends(subject: Subject) -> None:
    """SIGTERM ends the program. The end of its bus does, with a status other than 0."""
    scenario = _scenario(subject)
    with _started(subject, scenario, setup_text(scenario)) as stand:
        stand.advance(10 * scenario.period_ns)
        stand.side.process.terminate()
        _wait(stand, "SIGTERM")
    with _started(subject, scenario, setup_text(scenario)) as stand:
        stand.advance(10 * scenario.period_ns)
        stand.host.shutdown()
        _wait(stand, "the end of its bus")
        _expect_refusal(stand.side.failure(), "after the end of its bus ")


def _wait(stand: LockstepExecution, after: str) -> None:
    try:
        stand.side.process.wait(_END_S)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"it still runs {_END_S:g} s after {after}") from None
