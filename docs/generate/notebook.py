"""Runs the example notebook; ``python -m generate.notebook FOLDER`` writes its pictures there."""

from __future__ import annotations

import io
import sys
import tempfile
from base64 import b64decode
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

from rrins.host_tools.drawing.style import DPI

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_steps.ipynb"
NAMES = ("notebook_position", "notebook_scheme", "notebook_log")
"""Pictures of the notebook's plots, in its order; the table of a run holds its own."""


def execute(folder: Path, style: str = "") -> nbformat.NotebookNode:
    """Run the notebook in a folder, with lines of a matplotlibrc; return it with its outputs.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        When a cell fails.
    """
    (folder / "matplotlibrc").write_text(style, encoding="utf-8")
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
        shown = pictures_of(execute(Path(run_in), f"figure.dpi: {DPI}"))
    for name, picture in zip(NAMES, shown, strict=True):
        image = Image.open(io.BytesIO(picture)).convert("RGB")
        image.quantize(40).save(Path(sys.argv[1], f"{name}.png"), optimize=True, dpi=(DPI, DPI))
