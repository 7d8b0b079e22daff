"""The report: one self-contained HTML page; the plots are also written as files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.experiments.constants import REFERENCE
from rrins.host_tools.experiments.sections import BAND_SEEDS, FigureRow, Section
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.schemes import SCHEMES

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
    rows_3 = table_3(sections)
    return write_report(
        folder,
        "rrins.host_tools.experiments",
        {one.name: one.figure for section in sections for one in section.pictures},
        keeps=(REPORT,),
        filters={"figure": rounded},
        sections=sections,
        table_3=rows_3,
        differing=[(name, row) for name, cells in rows_3 for row in cells if row and row.differs],
        reference=REFERENCE.words,
        seeds=max(section.seeds for section in sections),
        band_seeds=BAND_SEEDS,
        table_1=_table_1() if any(s.experiment == "scheme" for s in sections) else [],
    )
