"""The exceptions that reach a user of the tools, each one clear line: what, where, what to do.

::

    RehearsalError            anything below; `exit_status` is what the command line ends with
    ├── ScenarioError         a scenario that is missing, broken or impossible
    ├── BusError              a bus that is not there, is taken, or broke
    ├── SideLostError         a firmware or hardware process that ended before its time
    ├── FirmwareFaultError    a run whose firmware ended in the mode FAULT
    ├── RecordError           a recording that cannot be begun or read, or went wrong
    ├── DifferenceError       two recordings, or a recording and its replay, differ
    ├── InjectionError        a fault that cannot be commanded live
    ├── MotionError           a motion that is missing, refused or impossible
    ├── ConformanceError      a program that does not do what the bus demands
    ├── MisleadingError       an error beyond the bound that the navigation states
    ├── ParameterFileError    a parameter memory that cannot be used
    ├── DiagError             a failure of the diagnostic tool
    │   ├── NoAnswerError             nobody answers its requests
    │   ├── NegativeResponseError     the navigation computer refuses one
    │   ├── CalibrationFileError      a calibration file that is missing, damaged or wrong
    │   └── RoutineFailedError        a routine that was awaited failed
    ├── XcpError              a failure of measurement and calibration over XCP
    └── Interrupted           the user stopped the run
"""

from __future__ import annotations


class RehearsalError(Exception):
    """Base of the project's errors; the message is meant for the user as it is."""

    exit_status = 1


class ScenarioError(RehearsalError):
    """A scenario that is missing, is not TOML, or holds an unknown key or impossible value."""

    exit_status = 3


class BusError(RehearsalError):
    """A bus that cannot be reached, is held by another process, or broke during a run."""

    exit_status = 4


class SideLostError(RehearsalError):
    """The firmware or the hardware process ended, or fell silent, before the rehearsal did."""

    exit_status = 5


class FirmwareFaultError(RehearsalError):
    """The run ended with the firmware in mode FAULT."""

    exit_status = 8


class MisleadingError(RehearsalError):
    """The navigation's error exceeded the bound that it stated."""

    exit_status = 14


class BuildError(RehearsalError):
    """Machine code for a target that cannot be made or linked here."""

    exit_status = 15


class ConformanceError(RehearsalError):
    """A navigation computer that does not do what this bus demands."""

    exit_status = 13


class ParameterFileError(RehearsalError):
    """A parameter memory whose file cannot be opened, is in use, or is something else."""

    exit_status = 11


class DiagError(RehearsalError):
    """A failure of the diagnostic tool that has no exit status of its own."""

    exit_status = 20


class NoAnswerError(DiagError):
    """Nobody answers diagnostic requests, or answers have stopped."""

    exit_status = 21


class NegativeResponseError(DiagError):
    """The navigation computer refuses a request.

    Parameters
    ----------
    message : str
    code : int
        The negative response code.
    """

    exit_status = 22

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class CalibrationFileError(DiagError):
    """A calibration file that is missing, damaged, not to be overwritten, or impossible."""

    exit_status = 23


class RoutineFailedError(DiagError):
    """A routine that was awaited did not succeed."""

    exit_status = 24


class CalibrationRecordError(RehearsalError):
    """A calibration's record that cannot be read or does not suffice, or a unit that failed it.

    With `rrins calibrate --strict` also one whose constants are less well known than is wanted.
    """

    exit_status = 12


class XcpError(RehearsalError):
    """A failure over XCP: nobody answers, a command is refused, or there is no such signal."""

    exit_status = 25
