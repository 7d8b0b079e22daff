"""Output of the diagnostic commands."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping

from rich import box
from rich.table import Table

from rrins.firmware_py.diagnostics.codecs import Field, Value
from rrins.host_tools.diag.values import value_text

_NAMES = ("field", "result")  # columns that must not wrap


def paragraph(text: str, indent: str = "  ") -> str:
    """Return text wrapped at 80 columns."""
    return textwrap.fill(text, 80, initial_indent=indent, subsequent_indent=indent + "  ")


def grid(*columns: str, heading: bool = True) -> Table:
    """Return an empty table with these headings; all but names may be wrapped in a terminal."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=heading)
    for number, column in enumerate(columns):
        table.add_column(column, overflow="fold", no_wrap=number == 0 or column in _NAMES)
    return table


def value_grid(
    columns: tuple[str, str], rows: Iterable[tuple[str, Iterable[Field], Mapping[str, Value]]]
) -> Table:
    """Return a table of values: the name of a thing, then each of its fields on a line."""
    table = grid(*columns, "value", "unit")
    for name, fields, values in rows:
        for label, field in zip(_once(name), fields, strict=False):
            table.add_row(label, field.name, value_text(field, values[field.name]), field.unit)
    return table


def _once(name: str) -> Iterator[str]:
    """Yield a name, then nothing."""
    yield name
    while True:
        yield ""
