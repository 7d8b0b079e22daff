"""Section 4.2: integrals of each constant error of sensor 3 over the 16 positions."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.experiments.sections import FigureRow, Picture, Section
from rrins.host_tools.rotation import pictures
from rrins.host_tools.rotation.analysis import VANISHES, Variation, analyse
from rrins.host_tools.rotation.inputs import rimu_of, scheme_of
from rrins.host_tools.rounding import rounded

EXPERIMENT: Final = "scheme"
GEOMETRIES: Final = ("tetrahedron", "dodecahedron", "cone")
SCHEME: Final = "16-position"
SENSOR: Final = 3

_ALL_VANISH = ("bias", "MEASF")
_LEAVE_Z = ("MESSF", "MEIE")


def _variation(geometry: str) -> Variation:
    rimu = rimu_of(geometry).rimu
    return analyse(scheme_of(SCHEME).scheme, rimu.gyros, rimu.accelerometers)


def _figure_rows(geometry: str, variation: Variation) -> list[FigureRow]:
    """Return a row for each error of the sensor and axis of the body."""
    rows = []
    for integrals in (variation.gyros, variation.accelerometers):
        kind, unit = integrals.sensors.kind, integrals.sensors.unit
        for row in integrals.residual_rows():
            if row.sensor != SENSOR:
                continue
            leaves_z = kind == "accelerometer" and row.error in _LEAVE_Z and row.axis == "z"
            largest, closed_form = rounded(row.excursion), rounded(row.closed_form)
            note = f"largest excursion {largest} {unit}; closed form {closed_form}"
            if leaves_z:
                note += "; per the paper a part remains"
            case = f"{geometry}, {kind} {SENSOR}, {row.error}"
            left = f"left after {SCHEME} on {row.axis} of the body"
            paper = None if leaves_z else 0.0
            rows.append(FigureRow(EXPERIMENT, case, left, unit, paper, row.residual, note))
    return rows


def statements(variation: Variation) -> dict[str, bool]:
    """Return whether the paper's statements hold for every sensor of both kinds."""
    gyros, accelerometers = variation.gyros, variation.accelerometers
    rows = list(accelerometers.residual_rows())
    return {
        "every gyro error integrates to zero": bool(gyros.vanishes.all()),
        "accelerometer bias and MEASF integrate to zero": all(
            row.vanishes for row in rows if row.error in _ALL_VANISH
        ),
        "accelerometer MESSF and MEIE leave nothing on x and y": all(
            row.vanishes for row in rows if row.error in _LEAVE_Z and row.axis != "z"
        ),
        "accelerometer MESSF and MEIE leave a part on z": any(
            not row.vanishes for row in rows if row.error in _LEAVE_Z and row.axis == "z"
        ),
    }


def _finding(geometry: str, variation: Variation) -> str:
    said = statements(variation)
    holding = "; ".join(words for words, holds in said.items() if holds)
    failing = "; ".join(words for words, holds in said.items() if not holds)
    text = f"{geometry}, for each of its sensors: {holding or 'no statement of the paper holds'}"
    return f"{text}. Does not hold: {failing}." if failing else f"{text}."


def reproduce() -> Section:
    """Analyse section 4.2 for the paper's geometry and two others."""
    section = Section(EXPERIMENT, "Error variation over the 16 positions (4.2)")
    section.open_rows = 0
    section.settings.append(
        "Gyros 0.1 °/h, λ = μ = 50 ppm, accelerometers 50 µg, λ = μ = 30 ppm, δu = δv = 10″ for "
        "both; 2 °/s, 10 s standing; integrals over one cycle of 1600 s, piecewise by "
        "Gauss-Legendre quadrature. "
        f"A residual below {VANISHES:g} of the error's excursion counts as zero."
    )
    for geometry in GEOMETRIES:
        variation = _variation(geometry)
        section.findings.append(_finding(geometry, variation))
        section.rows.extend(_figure_rows(geometry, variation))
        if geometry != GEOMETRIES[0]:
            continue
        for name, integrals in (
            ("figure_7", variation.gyros),
            ("figure_8", variation.accelerometers),
        ):
            kind = integrals.sensors.kind
            caption = f"{kind.capitalize()} {SENSOR}: its integrated errors, body axes."
            title = f"{kind.capitalize()} {SENSOR}: integrated errors in the body frame"
            drawn = pictures.draw(variation, integrals, SENSOR, title)
            section.pictures.append(Picture(name, caption, drawn))
    return section
