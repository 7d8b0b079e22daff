"""Reads CSV with one header row of names and units into a table."""

from __future__ import annotations

import csv
import difflib
from pathlib import Path

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.recording import located, shown
from rrins.host_tools.motion.table import (
    GROUPS,
    PLACE,
    TIME,
    RecordedTable,
    check_count,
    check_groups,
    text_of,
)

EXPORTED_ONLY = (
    *(f"omega_ib_b_{axis}_dps" for axis in "xyz"),
    *(f"specific_force_b_{axis}_mps2" for axis in "xyz"),
)
"""Columns of an export that are not needed to read it back: they follow from the path."""

_KNOWN = (TIME, *(name for group in GROUPS for name in group))


def _header(path: Path, cells: list[str], line: int) -> RecordedTable:
    check_count(path, len(cells), line)
    columns = tuple(cell.strip().lower() for cell in cells)
    if not any(name[:1].isalpha() for name in columns):
        raise MotionError(located(path, f"no header row with names such as {TIME}", line))
    for name in columns:
        if name and columns.count(name) > 1:
            raise MotionError(located(path, f"duplicate column {shown(name)}", line))
    for name in (TIME, *PLACE):
        if name not in columns:
            others = [column for column in columns if column not in _KNOWN]
            near = difflib.get_close_matches(name, others, 1, 0.4)
            hint = f"; rename {shown(near[0])} to it?" if near else ""
            raise MotionError(located(path, f"no column {name}{hint}", line))
    check_groups(path, columns, line)
    unused = tuple(name for name in columns if name not in (*_KNOWN, *EXPORTED_ONLY))
    return RecordedTable("csv", columns, unused=unused)


def _delimiter(text: str) -> str:
    """Return the column separator: a comma, else a semicolon or a tab in the header."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith(("#", "%")):
            return max(",;\t", key=line.count)
    return ","


def read_csv(path: Path) -> RecordedTable:
    """Return the rows of a file. Empty lines and lines starting with # or % are skipped.

    Raises
    ------
    MotionError
        If it cannot be read, or its header lacks a column.
    """
    text = text_of(path)
    rows = csv.reader(text.splitlines(keepends=True), delimiter=_delimiter(text))
    table: RecordedTable | None = None
    try:
        for cells in rows:
            if not any(cell.strip() for cell in cells) or cells[0].lstrip()[:1] in ("#", "%"):
                continue
            if table is None:
                table = _header(path, cells, rows.line_num)
            else:
                table.add(rows.line_num, cells)
    except csv.Error as error:
        raise MotionError(located(path, f"not CSV: {error}", rows.line_num)) from error
    if table is None:
        raise MotionError(located(path, "the file is empty"))
    return table
