"""The files of an explanation."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import IO

from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.explanation.explain import Explanation
from rrins.host_tools.explanation.picture import draw
from rrins.host_tools.explanation.reruns import QUANTITIES
from rrins.host_tools.files import make_folder, write_whole


def write(found: Explanation, folder: Path, title: str, of: str) -> list[Path]:
    """Write all parts as a table, and the picture, into a folder; return their paths.

    Raises
    ------
    RehearsalError
        When they cannot be written.
    """
    make_folder(folder)
    path = folder / "explain.csv"

    def write_rows(file: IO[str]) -> None:
        writer = csv.writer(file)
        writer.writerow(["source", "part", *QUANTITIES, *(f"alone_{name}" for name in QUANTITIES),
                         *(f"loss_{name}" for name in QUANTITIES)])  # fmt: skip
        for _, parts in found.by_size(of):
            for one in parts:
                figures = (*one.value, *one.alone[-1], *one.loss[-1])
                writer.writerow([one.source, one.part, *(f"{value:.6g}" for value in figures)])
        for name, values in (
            ("a unit without errors", found.rest[-1]),
            ("three or more together", found.together),
            ("the error", found.error[-1]),
        ):
            writer.writerow([name, "", *(f"{value:.6g}" for value in values)])

    write_whole(path, write_rows)
    return [path, *write_pictures(folder, {"explain": draw(found, title, of)})]
