"""Output of the diagnostic commands: tables for people, JSON for scripts."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence

import click
from rich import box
from rich.table import Table

from rrins.firmware_py.diagnostics.codecs import Field, Value
from rrins.host_tools import terminal
from rrins.host_tools.diag.values import value_text
from rrins.host_tools.files import JsonObject

_NAMES = ("field", "result")  # columns that must not wrap


def print_json(value: JsonObject | list[JsonObject]) -> None:
    """Print a JSON value on one line."""
    click.echo(json.dumps(value, ensure_ascii=False))


def print_line(text: str) -> None:
    """Print a line as is."""
    click.echo(text)


def print_paragraph(text: str, indent: str = "  ") -> None:
    """Print text wrapped at 80 columns."""
    click.echo(textwrap.fill(text, 80, initial_indent=indent, subsequent_indent=indent + "  "))


def new_table(columns: Sequence[str], heading: bool = True) -> Table:
    """Return an empty table with these headings; all but names may be wrapped in a terminal."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=heading)
    for number, column in enumerate(columns):
        is_name = number == 0 or column in _NAMES
        table.add_column(column, overflow="fold", no_wrap=is_name)
    return table


def print_table(table: Table) -> None:
    """Print a table without interpreting or highlighting its text."""
    terminal.print_table(table, terminal.new_console(highlight=False))


def field_rows(
    fields: Iterable[Field], values: Mapping[str, Value]
) -> Iterable[tuple[str, str, str]]:
    """Yield name, value and unit of each field."""
    for field in fields:
        yield field.name, value_text(field, values[field.name]), field.unit
