"""What a notebook needs besides."""

from __future__ import annotations

import sys


def is_notebook() -> bool:
    """Return whether this runs in a Jupyter kernel."""
    return "ipykernel" in sys.modules


def let_figures_show() -> None:
    """Let a figure that a cell returns be shown: pyplot tells the kernel how."""
    if is_notebook():
        import matplotlib.pyplot as plt

        assert plt
