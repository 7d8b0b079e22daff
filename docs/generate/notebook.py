"""Runs the example notebook; ``python -m generate.notebook FOLDER`` writes its pictures there."""

from __future__ import annotations

import sys
import tempfile
from base64 import b64decode
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_steps.ipynb"
NAMES = ("notebook_position", "notebook_scheme", "notebook_log")
"""Pictures of the notebook's plots, in its order; the table of a run holds its own."""


def execute(folder: Path) -> nbformat.NotebookNode:
    """Run the notebook in a folder; return it with its outputs.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        When a cell fails.
    """
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}})
    client.execute()
    return notebook


def pictures_of(notebook: nbformat.NotebookNode) -> list[bytes]:
    """Return the pictures that the cells show, as PNG."""
    return [
        b64decode(output["data"]["image/png"])
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "image/png" in output.get("data", {})
    ]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as run_in:
        shown = pictures_of(execute(Path(run_in)))
    for name, picture in zip(NAMES, shown, strict=True):
        Path(sys.argv[1], f"{name}.png").write_bytes(picture)
