"""Output of the tools: numbers, tables whose numbers stay whole, and progress at any width."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.progress import Progress, ProgressColumn, Task, TaskID
from rich.progress_bar import ProgressBar
from rich.table import Column, Table
from rich.text import Text

_UNBOUNDED = 100_000
_NARROWEST_BAR, _WIDEST_BAR = 6, 20
_LEFT = " left"
_SAID_EACH_S = 300.0


def new_console(*, stderr: bool = False, highlight: bool = True) -> Console:
    """Return a console that prints any text, such as a file name, as it stands.

    Brackets are not markup, and words between colons are not pictures.
    """
    return Console(stderr=stderr, highlight=highlight, markup=False, emoji=False)


def print_line(console: Console, text: str, **options: Any) -> None:
    """Print a line; in a terminal it goes on below between two words, elsewhere it stays whole."""
    console.print(
        folded(text, console.width) if console.is_terminal else text, soft_wrap=True, **options
    )


def folded(text: str, width: int, indent: int | None = None) -> str:
    """Return lines that break between words, and go on below, further in; a path stays whole.

    They go on `indent` places from the left, by default two further in than the line began.
    """
    return "\n".join(
        line if len(line) <= width else _folded(line, width, indent) for line in text.split("\n")
    )


def _folded(line: str, width: int, indent: int | None) -> str:
    begun = len(line) - len(line.lstrip(" ")) + 2 if indent is None else indent
    return textwrap.fill(
        line,
        width,
        subsequent_indent=" " * begun,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )


def new_table(title: str | None, *headings: str, **options: Any) -> Table:
    """Return an empty table: words in the first column, numbers in the others.

    Parameters
    ----------
    title : str, optional
    *headings : str
        One for each column.
    **options : optional
        As for `rich.table.Table`.
    """
    table = Table(title=title, title_justify="left", **options)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left", no_wrap=True)
    return table


def print_table(table: Table, console: Console | None = None) -> None:
    """Print a table; columns that are justified to the right, the numbers, are never wrapped.

    In a terminal that is too narrow the table continues below, its first column repeated. Anywhere
    else nothing is wrapped.
    """
    console = console or new_console()
    if table.title:
        print_line(console, str(table.title), style="italic", highlight=False)
        table.title = None
    for column in table.columns:
        if column.no_wrap or column.justify == "right":
            column.no_wrap, column.min_width = True, _natural_width(column, console)
    width = console.width if console.is_terminal else _UNBOUNDED
    for part in _parts(table, console, width):
        console.print(_AtWidth(part, width), crop=False)
    if table.caption:
        print_line(console, str(table.caption), style="dim italic", highlight=False)


class _AtWidth:
    """A table as on a console of another width."""

    def __init__(self, table: Table, width: int) -> None:
        self._table, self._width = table, width

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from console.render(self._table, options.update(width=self._width))


def _parts(table: Table, console: Console, width: int) -> Iterator[Table]:
    """Yield tables no wider than `width`: as many columns as fit, behind the first."""
    first, *others = table.columns
    if any(_least_width(_part(table, [first, one]), console) > width for one in others):
        first.no_wrap, first.min_width = False, None  # words may be wrapped, numbers not
    while others:
        count = len(others)
        while count > 1 and _least_width(_part(table, [first, *others[:count]]), console) > width:
            count -= 1
        yield _part(table, [first, *others[:count]])
        others = others[count:]
    if len(table.columns) == 1:
        yield table


def _natural_width(column: Column, console: Console) -> int:
    options = console.options.update(width=_UNBOUNDED)
    cells = (column.header, *column.cells)
    return max(Measurement.get(console, options, cell).maximum for cell in cells)


def _least_width(table: Table, console: Console) -> int:
    return Measurement.get(console, console.options.update(width=_UNBOUNDED), table).minimum


def _part(table: Table, columns: Sequence[Column]) -> Table:
    """Return a table like another, with some of its columns."""
    part = Table(
        box=table.box,
        pad_edge=table.pad_edge,
        show_edge=table.show_edge,
        show_header=table.show_header,
    )
    for column in columns:
        part.add_column(
            column.header,
            justify=column.justify,
            overflow=column.overflow,
            no_wrap=column.no_wrap,
            min_width=column.min_width,
            style=column.style,
        )
    for row, cells in zip(table.rows, zip(*(c.cells for c in columns), strict=True), strict=True):
        part.add_row(*cells, style=row.style, end_section=row.end_section)
    return part


class _Line(ProgressColumn):
    """Description, bar, percentage and time left; then of the field `state` what there is room for.

    `state` is a sequence of short texts, the most important first. A text is shown whole or not.
    """

    def render(self, task: Task) -> _TaskLine:
        return _TaskLine(task)


class _TaskLine:
    def __init__(self, task: Task) -> None:
        self._task = task

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        task, width = self._task, options.max_width
        figures = [f"{task.percentage:3.0f} %", _time_left(task)] if task.started else []
        room = width - sum(len(figure) + 1 for figure in figures)
        head = Text(task.description, style="bold", no_wrap=True, overflow="ellipsis")
        head.truncate(max(1, room if not task.started else room - _NARROWEST_BAR - 1))
        room -= head.cell_len + 1
        if room < _NARROWEST_BAR:  # nothing to measure yet, and a long text that says so
            yield head
            return
        bar_width = min(_WIDEST_BAR, room)
        room -= bar_width + 1
        if figures and room >= len(_LEFT):
            figures[-1] += _LEFT
            room -= len(_LEFT)
        shown = []
        for text in task.fields.get("state", ()):
            if cell_len(text) + 2 > room:
                break
            shown.append(text)
            room -= cell_len(text) + 2
        bar = ProgressBar(
            total=task.total,
            completed=task.completed,
            width=bar_width,
            pulse=not task.started,
            animation_time=task.get_time(),
        )
        grid = Table.grid(padding=(0, 1, 0, 0), pad_edge=False)
        cells: list[Text | ProgressBar | str] = [
            head,
            bar,
            *figures,
            *(["  ".join(shown)] if shown else []),
        ]
        for cell in cells:
            grid.add_column(no_wrap=True, width=bar_width if cell is bar else None)
        grid.add_row(*cells)
        yield grid


def _time_left(task: Task) -> str:
    """Return the time left, such as ``0:42`` or ``1:05:00``."""
    left_s = task.time_remaining
    if left_s is None:
        return "-:--"
    minutes, seconds = divmod(round(left_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{f'{hours}:{minutes:02}' if hours else minutes}:{seconds:02}"


class _Progress(Progress):
    """A progress line; where there is no terminal, a line of text every five minutes."""

    def __init__(self, console: Console, quiet: bool, **options: Any) -> None:
        is_shown = console.is_terminal and not quiet
        super().__init__(_Line(), console=console, transient=True, disable=not is_shown, **options)
        self._says = not (quiet or is_shown)
        self._said_s = self.get_time()

    def update(self, task_id: TaskID, *values: Any, **fields: Any) -> None:
        """Update a task; say how far it is, if that is due."""
        super().update(task_id, *values, **fields)
        task, now_s = self._tasks[task_id], self.get_time()
        if self._says and task.started and task.total and now_s - self._said_s >= _SAID_EACH_S:
            self._said_s = now_s
            head = f"{task.description}: {task.percentage:.0f} %, {_time_left(task)} left"
            print_line(self.console, "  ".join((head, *task.fields.get("state", ()))))


def progress_line(
    console: Console,
    quiet: bool = False,
    refresh_hz: float = 10,
    get_time: Callable[[], float] = time.monotonic,
) -> Progress:
    """Return a progress line with a bar and the time left, at any width of the terminal.

    Where there is no terminal, it says a line every five minutes. A task may have a field `state`:
    a sequence of short texts, the most important first; those that fit follow the time left.
    """
    return _Progress(console, quiet, refresh_per_second=refresh_hz, get_time=get_time)
