"""Tables of `rrins redundancy`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from rrins.host_tools.redundancy.monte_carlo import Delays
from rrins.host_tools.redundancy.report import WORDS, delay, given, pair
from rrins.host_tools.redundancy.survey import WITHIN_S, Group, Set, Study, Survey
from rrins.host_tools.redundancy.theory import HALF, MOST, WAYS
from rrins.host_tools.rounding import rounded
from rrins.host_tools.terminal import new_table

_HEAD_LETTERS = 13


def _head(survey: Survey, one: Set, group: Group) -> str:
    """Return the head of a column, in lines that are not too wide."""
    lines = [""]
    for part in survey.candidate.name.replace("-", "-\n").replace("_", "_\n").split("\n"):
        if len(lines[-1]) + len(part) > _HEAD_LETTERS and lines[-1]:
            lines.append("")
        lines[-1] += part
    if len(one.groups) > 1:
        lines.append(f"{one.kind.one} {group.words}" if len(one.kind.one) < 5 else group.words)
    return "\n".join(lines)


def _columns(study: Study, number: int) -> list[tuple[Survey, Set, Group]]:
    """Return the groups of a kind of all sets of sensors."""
    return [(s, s.sets[number], group) for s in study.surveys for group in s.sets[number].groups]


def smallest_table(study: Study, number: int) -> Table:
    """Return the smallest faults of a kind, a column for each set of sensors."""
    kind = study.surveys[0].sets[number].kind
    title = f"Smallest step of {kind.name} found / ({kind.unit}): theory, half / 95 %; runs, tried"
    columns = _columns(study, number)
    table = new_table(title, "known, within", *(_head(*column) for column in columns))
    for way in WAYS:
        for within_s in WITHIN_S:
            cells = [pair(*group.smallest[way][within_s]) for _, _, group in columns]
            for k, (survey, one, group) in enumerate(columns):
                cells[k] += f"; {given(survey.smallest_tried(one, group, way, within_s))}"
            last = within_s == WITHIN_S[-1]
            table.add_row(f"{WORDS[way]}, {within_s} s", *cells, end_section=last)
    return table


def side_by_side_table(study: Study, number: int) -> Table:
    """Return how soon half of a kind's faults are known, a column for each set of sensors."""
    kind = study.surveys[0].sets[number].kind
    has_runs = study.surveys[0].trials is not None
    title = f"Half of the steps of {kind.name} are known after / s"
    title += ": theory / runs" if has_runs else ", by theory"
    columns = _columns(study, number)
    heads = (_head(*column) for column in columns)
    table = new_table(title, f"known, step / ({kind.unit})", *heads)
    sizes = study.sizes[kind.name]
    for way in WAYS:
        for size in sizes:
            cells = []
            for survey, one, group in columns:
                at = int(abs(group.sizes - size).argmin())
                tried = survey.tried(one, group, size)
                sign = _sign(survey, one, group, size, way)
                runs = "" if tried is None else f"{sign}{delay(tried.quantile(way, HALF))}"
                cells.append(delay(group.delays[way][at][0]) + runs)
            table.add_row(f"{WORDS[way]}, {given(size)}", *cells, end_section=size == sizes[-1])
    return table


def delay_table(study: Study, survey: Survey, one: Set, group: Group) -> Table:
    """Return the delays of a group of sensors: theory, and the runs' beside it."""
    names = f", {one.kind.one} {group.words}" if len(one.groups) > 1 else ""
    title = f"{survey.candidate.name}{names}: delay / s after a step, half / 95 %"
    sizes = study.sizes[one.kind.name]
    tried = [survey.tried(one, group, size) for size in sizes]
    ways = [way for way in WAYS if _is_ever_found(group, tried, way)]
    heads = []
    for way in ways:
        words = WORDS[way].replace(", ", ",\n")
        heads += [f"{words}:\ntheory", *(["runs"] if any(tried) else [])]
    heads += ["wrong"] if any(tried) else []
    table = new_table(title, f"{one.kind.one[:_HEAD_LETTERS]}\n/ ({one.kind.unit})", *heads)
    table.columns[0].justify = "right"
    for size, delays in zip(sizes, tried, strict=True):
        at = int(abs(group.sizes - size).argmin())
        cells = []
        for way in ways:
            cells.append(pair(*group.delays[way][at]))
            if delays is not None:
                figures = pair(*(delays.quantile(way, p) for p in (HALF, MOST)))
                cells.append(_sign(survey, one, group, size, way).strip(" /") + figures)
        if delays is not None:
            cells.append(f"{delays.wrong} of {delays.right + delays.wrong}")
        table.add_row(given(size), *cells)
    return table


def _sign(survey: Survey, one: Set, group: Group, size: float, way: str) -> str:
    """Return what stands between theory and runs."""
    return " ≠ " if way in survey.doubted(one, group, size) else " / "


def _is_ever_found(group: Group, tried: Sequence[Delays | None], way: str) -> bool:
    """Return whether a way finds any of the faults, by theory or in the runs."""
    by_theory = bool(np.isfinite(group.delays[way]).any())
    return by_theory or any(
        delays is not None and math.isfinite(delays.quantile(way, HALF)) for delays in tried
    )


def lines_below(study: Study) -> list[str]:
    """Return whether theory fails; the false alarms that are promised, and those of the runs."""
    lines = []
    if any(
        survey.doubted(one, group, size)
        for survey in study.surveys
        for one in survey.sets
        for group in one.groups
        for size in study.sizes[one.kind.name]
    ):
        lines.append("≠: theory fails there, too many runs are later than it says; the runs count")
    for survey in study.surveys:
        promised = survey.candidate.scenario.redundancy.false_alarms_per_1000_h
        finder = survey.sets[0].finder
        line = (
            f"{survey.candidate.name}: {given(promised)} false alarms in 1000 h promised, so "
            f"{finder.second_factor:.2f} σ, below a second {finder.epoch_factor:.2f} σ"
        )
        if survey.trials is not None:
            line += f"; {survey.trials.alarms} in {rounded(survey.trials.sound_h)} h of runs"
        lines.append(line)
    return lines
