"""The command `rrins diag`."""

from __future__ import annotations

import click

from rrins.host_tools.cli.diag.calibration import calibration
from rrins.host_tools.cli.diag.did import did
from rrins.host_tools.cli.diag.dtc import dtc
from rrins.host_tools.cli.diag.memory import memory
from rrins.host_tools.cli.diag.routine import routine
from rrins.host_tools.cli.diag.session import identify, reset, session
from rrins.host_tools.cli.diag.shell import shell
from rrins.host_tools.cli.group import Group


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
def diag() -> None:
    """Diagnose and configure the navigation computer by UDS (ISO 14229) on CAN.

    Exit status: 0 success, 2 usage error, 4 no such bus, 20 any other error, 21 no answer, 22
    negative response, 23 invalid calibration file, 24 failed routine.
    """


for _command in (calibration, did, dtc, identify, memory, reset, routine, session, shell):
    diag.add_command(_command)
