"""The report: one self-contained HTML page, the pictures also as files."""

from __future__ import annotations

import base64
import io
from importlib import metadata
from pathlib import Path
from typing import IO, Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from host_tools.experiments.constants import REFERENCE
from host_tools.experiments.results import Row, Section, figure
from host_tools.results import taking_place, write_whole
from host_tools.schemes import SCHEMES

NAME = "report.html"
_COLOURS = 128

_SCHEME = "16-position"

_STATIC = tuple(f"largest position error, {side}" for side in ("east", "north"))
_TABLE_3: Final = (
    ("strapdown IMU", "imu_strapdown", None),
    ("rotating IMU", "imu_rotating", None),
    ("strapdown RIMU", "rimu_strapdown", "strapdown"),
    ("rotating RIMU", "rimu_rotating", "rotating"),
)
"""Rows of the paper's table 3: its name, our scenario at standstill, the way in 4.4 and 4.5."""


def table_3(sections: list[Section]) -> list[tuple[str, tuple[Row | None, ...]]]:
    """Return table 3 as in the paper: a name, and the five figures of its row where there are any.

    Of the experiment (4.4) those of the set `REFERENCE`, of the drive (4.5) those of route 1.
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


def _table_1() -> list[tuple[Any, ...]]:
    angle = {"inner": 0.0, "outer": 0.0}
    rows = []
    for number, turn in enumerate(SCHEMES[_SCHEME], 1):
        angle[turn.axis] += turn.angle_deg
        shown = (f"{value:+.0f}" for value in (turn.angle_deg, angle["inner"], angle["outer"]))
        rows.append((number, turn.axis, *shown))
    return rows


def _png(picture: Any) -> bytes:
    """Return a picture as PNG with a palette: a third of the size, and nothing to be seen of it."""
    drawn, packed = io.BytesIO(), io.BytesIO()
    picture.savefig(drawn, format="png", dpi=110)
    image = Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    image.save(packed, format="png", optimize=True)
    return packed.getvalue()


def write(folder: Path, sections: list[Section]) -> list[Path]:
    """Write the report and its pictures into a folder; return their paths, the report first."""
    pictures = {p.name: _png(p.figure) for section in sections for p in section.pictures}
    environment = Environment(
        loader=PackageLoader("host_tools.experiments", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters["figure"] = figure
    rows_3 = table_3(sections)
    text = environment.get_template("report.html.j2").render(
        sections=sections,
        table_3=rows_3,
        differing=[(name, row) for name, cells in rows_3 for row in cells if row and row.differs],
        reference=REFERENCE.words,
        table_1=_table_1() if any(s.experiment == "scheme" for s in sections) else [],
        images={name: base64.b64encode(data).decode("ascii") for name, data in pictures.items()},
        version=f"rrins {metadata.version('rrins')}",
    )

    def write_text(file: IO[str]) -> None:
        file.write(text)

    paths = [folder / NAME]
    write_whole(paths[0], write_text)
    for name, data in pictures.items():
        path = folder / f"{name}.png"
        with taking_place(path) as part:
            part.write_bytes(data)
        paths.append(path)
    return paths
