"""Output shared by the commands: results, notes, and the folders for results."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.interruption import as_event

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.files import JsonObject


def print_text(text: str, err: bool = False, indent: int | None = None) -> None:
    """Print lines; in a terminal a long one goes on below, between two words.

    It goes on `indent` places from the left, or a little further in than it began.
    """
    if (sys.stderr if err else sys.stdout).isatty():
        from rrins.host_tools.terminal import folded

        text = folded(text, shutil.get_terminal_size().columns, indent)
    click.echo(text, err=err)


def print_note(text: str) -> None:
    """Print a note to standard error, separate from the results."""
    print_text(f"rrins: {text}", err=True)


def print_json(values: Mapping[str, Any] | list[JsonObject]) -> None:
    """Print a JSON value on one line."""
    click.echo(json.dumps(values))


def print_results(
    as_json: bool, values: Mapping[str, Any] | list[JsonObject], parts: Iterable[Table | str]
) -> None:
    """Print one JSON object, or the tables and lines for people."""
    if as_json:
        print_json(values)
        return
    from rrins.host_tools.terminal import print_table

    for part in parts:
        if isinstance(part, str):
            print_text(part)
        else:
            print_table(part)


@contextmanager
def counting(what: str, total: int | None, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """Show the progress of a task; yield a callback for how much of it is done."""
    from rrins.host_tools.terminal import new_console, progress_line

    with progress_line(new_console(stderr=True), quiet) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)


@contextmanager
def stepping(what: str, total: int) -> Iterator[Callable[[], None]]:
    """Show the progress of a task; yield a callback for each step that is done."""
    done = itertools.count(1)
    with counting(what, total) as on_progress:
        yield lambda: on_progress(next(done))


@contextmanager
def stopping() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C sets; raise KeyboardInterrupt at the end if it was."""
    with as_event() as stop:
        yield stop
        if stop.is_set():
            raise KeyboardInterrupt


def make_folder(folder: Path) -> Path:
    """Return the folder of ``--out``, created.

    Raises
    ------
    RehearsalError
        If it cannot be created or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be created: {error.strerror}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise RehearsalError(f"--out {folder}: cannot be written to")
    return folder
