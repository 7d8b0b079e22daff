"""The report: one self-contained HTML page; the plots are also written as files."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import IO, Final

from rrins.host_tools.drawing.page import base64_of, environment, png_of
from rrins.host_tools.experiments.constants import REFERENCE
from rrins.host_tools.experiments.sections import BAND_SEEDS, FigureRow, Section, figure
from rrins.host_tools.files import keep, replacing, write_whole
from rrins.host_tools.scenario.schemes import SCHEMES

NAME = "report.html"
_SCHEME = "16-position"

_STATIC = tuple(f"largest position error, {side}" for side in ("east", "north"))
_TABLE_3: Final = (
    ("strapdown IMU", "imu_strapdown", None),
    ("rotating IMU", "imu_rotating", None),
    ("strapdown RIMU", "rimu_strapdown", "strapdown"),
    ("rotating RIMU", "rimu_rotating", "rotating"),
)
"""Rows of the paper's table 3: name, our static scenario, the way in 4.4 and 4.5."""


def table_3(sections: list[Section]) -> list[tuple[str, tuple[FigureRow | None, ...]]]:
    """Return table 3 as in the paper: a name, and up to five figures of its row.

    The experiment (4.4) uses the set `REFERENCE`, the drive (4.5) route 1.
    """
    rows = {(row.case, row.quantity): row for section in sections for row in section.rows}
    table = []
    for name, scenario, way in _TABLE_3:
        east, north = (f"largest position error, {way}, {side}" for side in ("east", "north"))
        keys = (
            *((scenario, quantity) for quantity in _STATIC),
            *((REFERENCE.words, quantity) for quantity in (east, north)),
            ("route 1", f"end point error, {way}"),
        )
        table.append((name, tuple(rows.get(key) for key in keys)))
    return [entry for entry in table if any(entry[1])]


def _table_1() -> list[tuple[int | str, ...]]:
    angle = {"inner": 0.0, "outer": 0.0}
    rows = []
    for number, turn in enumerate(SCHEMES[_SCHEME], 1):
        angle[turn.axis] += turn.angle_deg
        shown = (f"{value:+.0f}" for value in (turn.angle_deg, angle["inner"], angle["outer"]))
        rows.append((number, turn.axis, *shown))
    return rows


def write(folder: Path, sections: list[Section]) -> list[Path]:
    """Write the report and its plots to a folder; return their paths, the report first.

    A report of other content that is there is moved into the folder `previous`; it holds its plots.
    """
    pictures = {p.name: png_of(p.figure) for section in sections for p in section.pictures}
    templates = environment("rrins.host_tools.experiments")
    templates.filters["figure"] = figure
    rows_3 = table_3(sections)
    text = templates.get_template("report.html.j2").render(
        sections=sections,
        table_3=rows_3,
        differing=[(name, row) for name, cells in rows_3 for row in cells if row and row.differs],
        reference=REFERENCE.words,
        seeds=max(section.seeds for section in sections),
        band_seeds=BAND_SEEDS,
        table_1=_table_1() if any(s.experiment == "scheme" for s in sections) else [],
        images={name: base64_of(data) for name, data in pictures.items()},
        version=f"rrins {metadata.version('rrins')}",
    )

    def write_text(file: IO[str]) -> None:
        file.write(text)

    paths = [folder / NAME]
    if paths[0].exists() and paths[0].read_bytes() != text.encode():
        keep(folder, (NAME,))
    write_whole(paths[0], write_text)
    for name, data in pictures.items():
        path = folder / f"{name}.png"
        with replacing(path) as part:
            part.write_bytes(data)
        paths.append(path)
    return paths
