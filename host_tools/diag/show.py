"""What the commands show: tables for people, JSON for scripts."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import click
from rich import box
from rich.console import Console
from rich.table import Table

from firmware_py.diagnostics.codecs import Field, Value
from host_tools.diag.values import shown

_NAMES = ("field", "result")  # columns that are not to be broken


def as_json(value: Any) -> None:
    """Print a JSON object in one line."""
    click.echo(json.dumps(value, ensure_ascii=False))


def line(text: str) -> None:
    """Print a line as it is."""
    click.echo(text)


def paragraph(text: str, indent: str = "  ") -> None:
    """Print text in lines of 80 columns at most."""
    click.echo(textwrap.fill(text, 80, initial_indent=indent, subsequent_indent=indent + "  "))


def note(text: str) -> None:
    """Say something beside the results, on standard error."""
    click.echo(f"rrins: {text}", err=True)


def grid(columns: Sequence[str], heading: bool = True) -> Table:
    """Return an empty table with these headings; a line needs no more than 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=heading)
    for number, column in enumerate(columns):
        is_name = number == 0 or column in _NAMES
        table.add_column(column, overflow="fold", no_wrap=is_name)
    return table


def put(table: Table) -> None:
    """Print a table; nothing of it is marked up or coloured by what it says."""
    Console(highlight=False, markup=False, emoji=False).print(table)


def rows_of(fields: Iterable[Field], values: Mapping[str, Value]) -> Iterable[tuple[str, str, str]]:
    """Yield name, value and unit of each field."""
    for field in fields:
        yield field.name, shown(field, values[field.name]), field.unit
