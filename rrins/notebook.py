"""Additions for notebooks."""

from __future__ import annotations

import html
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def is_notebook() -> bool:
    """Return whether this runs in a Jupyter kernel."""
    return "ipykernel" in sys.modules


class NotebookLine:
    """A line below a notebook's cell that is written anew: progress."""

    def __init__(self) -> None:
        self._handle: Any = None

    def show(self, text: str) -> None:
        """Write the line anew."""
        from IPython.display import display

        shown = {"text/plain": text}
        if self._handle is None:
            self._handle = display(shown, raw=True, display_id=True)
        else:
            self._handle.update(shown, raw=True)


def let_figures_show() -> None:
    """Let a figure that a cell returns be shown: pyplot tells the kernel how."""
    if is_notebook():
        import matplotlib.pyplot as plt

        assert plt


def html_of(result: object, table: pd.DataFrame, has_index: bool = True) -> str:
    """Return what a notebook shows of a result: its words and a table."""
    words = html.escape(repr(result).strip("<>"))
    return f"<p>{words}</p>{table.to_html(index=has_index)}"
