"""The command `rrins diag`."""

from __future__ import annotations

import click

from host_tools.diag.calibration import calibration
from host_tools.diag.did import did
from host_tools.diag.dtc import dtc
from host_tools.diag.memory import memory
from host_tools.diag.routine import routine
from host_tools.diag.session import identify, reset, session
from host_tools.diag.shell import shell


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def diag() -> None:
    """Look into the navigation computer, and change it, by UDS (ISO 14229) on CAN.

    Exit status: 0 done, 2 wrong use, 4 no such bus, 20 anything else, 21 nobody answers, 22 the
    computer refuses, 23 a calibration file that is wrong, 24 a routine that failed.
    """


for _command in (calibration, did, dtc, identify, memory, reset, routine, session, shell):
    diag.add_command(_command)
