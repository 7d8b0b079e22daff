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
    """The run came to its end, but the firmware was in the mode FAULT by then."""

    exit_status = 8
