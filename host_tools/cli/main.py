"""The command `rrins`: its table of subcommands, and how errors are reported."""

from __future__ import annotations

import gc
import keyword
import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final, NoReturn

import click
from click.shell_completion import CompletionItem

from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.standard_streams import OutputError, guarded_streams
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.interruption import INTERRUPTED

_GC_THRESHOLD = 50_000
"""Allocations between collections: startup creates hundreds of thousands of lasting objects."""


@dataclass(frozen=True)
class _Entry:
    """A command: its module in this package, imported only when it runs, and its one-line help."""

    module: str
    line: str


_RUN = {
    "rehearse": _Entry("run.run", "Run firmware and hardware as two processes on one bus."),
    "simulate": _Entry("run.run", "Run firmware and hardware in one process, without a bus."),
    "firmware": _Entry("run.run", "Run the navigation computer alone."),
    "hardware": _Entry("run.run", "Run the emulated RIMU and turntable alone."),
    "setup": _Entry("run.scenarios", "Show what a navigation computer of your own is set up with."),
    "calibrate": _Entry("unit.calibrate", "Calibrate a unit's sensors on its own table."),
    "inject": _Entry("run.inject", "Inject a fault into a running rehearsal."),
    "scenarios": _Entry("run.scenarios", "List or show the built-in scenarios."),
    "conform": _Entry("unit.conform", "Check a navigation computer of your own, rule by rule."),
    "build": _Entry("unit.build", "Build the steps as machine code for another processor."),
    "bench": _Entry("run.bench", "Measure what a rehearsal costs on this machine."),
}
_LOOK = {
    "monitor": _Entry("bus.monitor", "Watch the decoded bus in the terminal."),
    "dashboard": _Entry("bus.dashboard", "Show a rehearsal or a log in a browser."),
    "tour": _Entry("run.tour", "Tell in five minutes what this is for."),
    "diag": _Entry("diag.diag", "Diagnose the navigation computer over UDS."),
    "xcp": _Entry("unit.xcp", "Measure and calibrate the navigation computer over XCP."),
    "record": _Entry("bus.record", "Record a bus to a log file."),
    "import": _Entry("vehicle.import_vehicle", "Convert the recording of a real vehicle to a log."),
    "replay": _Entry("log.replay", "Replay a log onto a bus or through the firmware."),
    "export": _Entry("log.export", "Write a log, or what describes the bus, for other tools."),
    "increments": _Entry(
        "vehicle.increments", "Write fused increments and truth for other navigators."
    ),
    "plot": _Entry("log.plot", "Plot signals of a log over time."),
    "socketcand": _Entry("bus.bridges", "Serve the embedded bus to socketcand clients."),
    "slcan": _Entry("bus.bridges", "Serve the embedded bus as an slcan adapter."),
}
_PLAN = {
    "scheme": _Entry("scheme.scheme", "Analyse, compare and search rotation schemes."),
    "redundancy": _Entry("redundancy.redundancy", "Show which faults redundant sensors can find."),
    "integrity": _Entry(
        "integrity.integrity", "Compare the error with its bound in random cases of faults."
    ),
    "fmeda": _Entry(
        "integrity.fmeda", "Show what becomes of a unit's failures, weighted by their rates."
    ),
    "motion": _Entry("vehicle.motion", "Check recorded vehicle motion; export true motion."),
    "campaign": _Entry(
        "campaign.campaign", "Run a scenario thousands of times with different values."
    ),
    "covariance": _Entry(
        "budget.covariance", "Analyse σ of the navigation, and each error source's share."
    ),
    "allocate": _Entry(
        "budget.allocate", "Find the tolerances of least cost that meet a requirement."
    ),
    "explain": _Entry("budget.explain", "Explain an error: what each source contributes to it."),
    "reproduce": _Entry("run.reproduce", "Run the paper's experiments."),
}
_SECTIONS: Final = {"Run": _RUN, "Look": _LOOK, "Plan": _PLAN}
_COMMANDS: Final = _RUN | _LOOK | _PLAN


_EXTRAS = {
    "SALib": "campaign",
    "asammdf": "mf4",
    "distributed": "dask",
    "mcap": "mcap",
    "odxtools": "odx",
    "pandas": "data",
    "pyarrow": "tables",
    "pyxcp": "xcp",
    "xarray": "data",
    "ziglang": "build",
}
"""Extras of the installation by the packages that they bring."""


class _Group(Group):
    """A group that imports commands lazily and reports user errors in one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command from its module and return it."""
        if cmd_name not in _COMMANDS:
            return None
        name = f"{cmd_name}_" if keyword.iskeyword(cmd_name) else cmd_name
        command = getattr(import_module(f"{__package__}.{_COMMANDS[cmd_name].module}"), name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, one section per purpose."""
        width = max(map(len, _COMMANDS))
        for title, entries in _SECTIONS.items():
            with formatter.section(title):
                rows = [(name.ljust(width), entry.line) for name, entry in entries.items()]
                formatter.write_dl(rows)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the commands that start with `incomplete`, and click's own completions."""
        begun = [
            CompletionItem(name, help=entry.line)
            for name, entry in sorted(_COMMANDS.items())
            if name.startswith(incomplete)
        ]
        return begun + click.Command.shell_complete(self, ctx, incomplete)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except RehearsalError as error:
            _fail(str(error), error.exit_status)
        except KeyboardInterrupt:
            _fail("stopped by the user", INTERRUPTED)
        except _errors_of_dbc() as error:
            _fail(str(error), RehearsalError.exit_status)
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in _EXTRAS:
                raise
            extra = f"rrins[{_EXTRAS[package]}]"
            _fail(f"this needs {package}: pip install '{extra}'", RehearsalError.exit_status)


def _errors_of_dbc() -> tuple[type[Exception], ...]:
    """Return the exceptions of an unusable DBC and of an unsafe folder of compiled code.

    Only those of modules that have been imported.
    """
    kinds = (("dbc.codec", "ContractError"), ("compiled.code_folder", "CodeFolderError"))
    homes = ((sys.modules.get(f"rrins.{module}"), name) for module, name in kinds)
    return tuple(getattr(home, name) for home, name in homes if home is not None)


def _fail(message: str, exit_status: int) -> NoReturn:
    """Report in one line what went wrong and exit."""
    line = "".join(c if c.isprintable() else _escaped(c) for c in message)
    from rrins.host_tools.cli.output import print_text

    print_text(f"rrins: {line}", err=True)
    sys.exit(exit_status)


def _escaped(character: str) -> str:
    """Return what a file name or a cell may hold and a line may not, as an escape."""
    return character.encode("unicode_escape", "surrogatepass").decode()


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rrins", prog_name="rrins")
def rrins() -> None:
    """Rehearse a redundant rotational inertial navigation system before its hardware exists.

    A firmware process navigates and drives the turntable; a hardware process produces the sensor
    frames; a CAN bus connects them.
    """
    logging.basicConfig(format="rrins: %(message)s", level=logging.WARNING)


def _leave_out_asammdf(arguments: Sequence[str]) -> None:
    """Keep python-can from importing asammdf, and pandas with it, unless an .mf4 file is named.

    If asammdf is installed, python-can imports it at once: a third of all startup imports. The
    file extension decides the format.
    """
    if not any(".mf4" in argument.lower() for argument in arguments):
        sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # as Python marks one


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line: the process's, or words that stand behind `rrins`."""
    words = sys.argv[1:] if words is None else words
    gc.set_threshold(_GC_THRESHOLD)
    _leave_out_asammdf(words)
    try:
        with guarded_streams():
            rrins(words, prog_name="rrins", obj=main)
    except OutputError as error:  # help and completion are printed before a command runs
        _fail(str(error), error.exit_status)
    finally:
        gc.freeze()  # saves half a second of garbage collection at exit
