"""The report: one self-contained HTML page, the pictures also as files."""

from __future__ import annotations

import base64
import io
from importlib import metadata
from pathlib import Path
from typing import IO, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from host_tools.experiments.results import Row, Section
from host_tools.results import write_whole
from host_tools.schemes import SCHEMES

NAME = "report.html"

_TABLE_3 = ("position error", "end point")
_SCHEME = "16-position"


def figure(value: float | None) -> str:
    """Return a number as the tables show it: three digits."""
    if value is None:
        return "–"
    if value == 0 or 1e-2 <= abs(value) < 1e5:
        return f"{value:,.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return f"{value:.2e}"


def _table_3(sections: list[Section]) -> list[Row]:
    """Return the rows that the paper's table 3 has."""
    return [
        row
        for section in sections
        for row in section.rows
        if row.experiment != "scheme"
        and row.paper is not None
        and row.note != "variant"
        and row.unit == "m"
        and any(words in row.quantity for words in _TABLE_3)
    ]


def _table_1() -> list[tuple[Any, ...]]:
    angle = {"inner": 0.0, "outer": 0.0}
    rows = []
    for number, turn in enumerate(SCHEMES[_SCHEME], 1):
        angle[turn.axis] += turn.angle_deg
        shown = (f"{value:+.0f}" for value in (turn.angle_deg, angle["inner"], angle["outer"]))
        rows.append((number, turn.axis, *shown))
    return rows


def _png(picture: Any) -> bytes:
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


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
    text = environment.get_template("report.html.j2").render(
        sections=sections,
        table_3=_table_3(sections),
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
        part = path.with_name(f".{path.name}")
        part.write_bytes(data)
        part.replace(path)
        paths.append(path)
    return paths
