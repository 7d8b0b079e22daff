"""The picture of what was estimated of each sensor: beside the truth, inside three times sigma."""

from __future__ import annotations

from matplotlib.figure import Figure

from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure, quantity
from rrins.host_tools.files import JsonObject

_SIGMAS = 3.0
_KINDS = {"gyros": ("dph", "°/h"), "accelerometers": ("ug", "µg")}
_LABELS = {
    "scale_error_ppm": ("scale factor λ", "ppm"),
    "asymmetric_scale_error_ppm": ("asymmetry μ", "ppm"),
    "installation_u_arcsec": ("installation δu", "″"),
    "installation_v_arcsec": ("installation δv", "″"),
}


def draw_constants(estimator: JsonObject, title: str) -> Figure:
    """Return bias, scale factors and installation errors of each sensor: estimated, and true.

    Parameters
    ----------
    estimator : dict
        Key `estimator` of a run's summary, with constants; the truth is left out where it is null.
    title : str
    """
    figure = new_figure(9.0, 8.6)
    panels = figure.subplots(1 + len(_LABELS), len(_KINDS), squeeze=False)
    give_title(figure, f"{title}\nestimated with ±3σ (bars) and true (crosses)")
    for column, (kind, (suffix, unit)) in enumerate(_KINDS.items()):
        of_kind = estimator["sensors"][kind]
        rows = [
            (
                quantity("bias", unit),
                of_kind[f"bias_{suffix}"],
                of_kind[f"sigma_{suffix}"],
                of_kind[f"true_bias_{suffix}"],
            )
        ]
        for key, found in of_kind["constants"].items():
            label = quantity(*_LABELS[key])
            rows.append((label, found["estimated"], found["sigma"], found["true"]))
        for row, (label, values, sigma, true) in enumerate(rows):
            axes = panels[row, column]
            numbers = range(1, len(values) + 1)
            spread = [_SIGMAS * one for one in sigma]
            axes.errorbar(numbers, values, spread, fmt="o", markersize=3.5, capsize=4, **_colour(0))
            if true is not None:
                axes.plot(numbers, true, "x", markersize=8, **_colour(1))
            finish(axes, label, zero_line=True)
            axes.set_xlim(0.5, len(values) + 0.5)
            axes.set_xticks(list(numbers))
        panels[0, column].set_title(kind, fontsize="medium")
        panels[-1, column].set_xlabel("sensor")
    figure.align_ylabels()
    return figure


def _colour(line: int) -> dict[str, str]:
    return {"color": str(LINES[line]["color"])}
