"""Draws the pictures of other people's tools: ``python -m generate.tool_pictures [NAME…]``.

For `docs/files-for-tools.md`. Each tool reads what `rrins` has written in a rehearsal of 80 s, in
which a gyro fails; a picture of a terminal is what its commands say there, word by word.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

import asammdf
import duckdb
import numpy as np
from matplotlib.axes import Axes
from mcap.reader import make_reader
from rich.console import Console
from rich.text import Text

from rrins.host_tools.drawing.saving import write_picture
from rrins.host_tools.drawing.style import LINES, draw_line, finish, legend_above, new_figure

TO = Path(__file__).parents[1] / "pictures"
_PATIENCE_S = 300.0
_SINCE = "time since power-on / s"
_BUS = ("--channel", "tools")

_SCENARIO = """\
duration_s = 80.0
[firmware]
turn_rate_dps = 20.0
stand_s = 2.0
[gyros]
angle_random_walk_deg_per_sqrt_h = 0.05
[xcp]
[[faults]]
kind = "gyro_bias"
sensor = 3
at_s = 40.0
bias_dph = 20.0
"""
_ANGLES = tuple(f"assembly.encoder_angle_deg[{k}]" for k in range(2))
_RESIDUAL = "redundancy.gyros.residual[2]"
_RATIO, _EXCLUDED = "redundancy.gyros.ratio", "redundancy.gyros.excluded"


def _rrins(*words: str) -> list[str]:
    return [sys.executable, "-m", "rrins", *words]


def rehearse(folder: Path) -> None:
    """Rehearse in a folder; leave the bus in ``bus.log``, what XCP measured in ``turn.mf4``.

    Raises
    ------
    TimeoutError
        When nothing could be measured.
    """
    (folder / "tools.toml").write_text(_SCENARIO, encoding="utf-8")
    words = ("rehearse", "tools.toml", "--speed", "2", "--record", "bus.log", *_BUS)
    side = subprocess.Popen(_rrins(*words, "--json"), cwd=folder, stdout=subprocess.DEVNULL)
    signals = (*_ANGLES, _RESIDUAL, _RATIO, _EXCLUDED)
    record = _rrins("xcp", "record", "turn.mf4", *signals, "--for", "45", *_BUS)
    until = time.monotonic() + _PATIENCE_S
    try:
        while subprocess.run(record, cwd=folder, capture_output=True, check=False).returncode:
            if time.monotonic() > until or side.poll() is not None:
                raise TimeoutError("no rehearsal to measure has begun, or it has ended before")
        side.wait(_PATIENCE_S)
    finally:
        side.kill()


def terminal(folder: Path, name: str, width: int, *commands: str) -> None:
    """Draw a terminal in which commands are typed, and what they say.

    Raises
    ------
    subprocess.CalledProcessError
        When one fails.
    """
    programs = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    asks = {"PATH": programs, "COLUMNS": str(width), "FORCE_COLOR": "1", "TERM": "xterm-256color"}
    screen = Console(file=io.StringIO(), record=True, width=width, force_terminal=True)
    for command in commands:
        done = subprocess.run(
            command, shell=True, cwd=folder, env=os.environ | asks, text=True, check=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        screen.print(Text(f"$ {command}", style="bold"))
        screen.print(Text.from_ansi(done.stdout.strip("\n")))
    svg = screen.export_svg(title="", unique_id=name)
    # Some viewers fold spaces, even those that do not break.
    svg = svg.replace("<text ", '<text xml:space="preserve" ')
    (TO / f"{name}.svg").write_text(svg, encoding="utf-8")


def pdx(folder: Path) -> None:
    """Draw what odxtools lists of the PDX."""
    listing = "odxtools list rrins.pdx -v navigation_computer_0_1_0 -p -s write_bridge"
    terminal(folder, "tool_pdx", 114, "rrins export rrins.pdx", f"{listing} | head -38")


def dialects(folder: Path) -> None:
    """Draw what cantools reads in a recorded frame by the contract in each dialect."""
    commands = []
    for ending in ("arxml", "kcd", "sym"):
        commands += [
            f"rrins export bus.{ending}",
            f"grep ' 060#' bus.log | tail -1 | cantools decode bus.{ending}",
        ]
    terminal(folder, "tool_dialects", 72, *commands)


def xcp(folder: Path) -> None:
    """Draw what XCP has measured, as asammdf reads it."""
    with asammdf.MDF(folder / "turn.mf4") as file:
        found = {name: file.get(name) for name in (*_ANGLES, _RESIDUAL, _RATIO, _EXCLUDED)}
    excluded = found[_EXCLUDED]
    at_s = excluded.timestamps[excluded.samples > 0][:1]
    figure = new_figure(7.5, 6.0)
    panels: tuple[Axes, ...] = tuple(figure.subplots(3, 1, sharex=True))
    groups = (_ANGLES, "°"), ((_RESIDUAL,), "rad"), ((_RATIO,), "parity / threshold")
    for axes, (names, unit) in zip(panels, groups, strict=True):
        for name, line in zip(names, LINES, strict=False):
            samples = found[name].samples
            if name not in _ANGLES:  # nothing is compared any more
                samples = np.where(excluded.samples > 0, np.nan, samples)
            draw_line(axes, found[name].timestamps, samples, label=name, **line)
        for time_s in at_s:
            axes.axvline(time_s, color="0.3", linewidth=0.8)
            if axes is not panels[0]:
                axes.annotate(
                    "gyro 3 left out", (time_s, 0.93), (-6, 0), xycoords=("data", "axes fraction"),
                    textcoords="offset points", va="center", ha="right", fontsize="small",
                )  # fmt: skip
        finish(axes, unit)
        legend_above(axes)
    panels[-1].set_xlabel(_SINCE)
    write_picture(TO / "tool_xcp.png", figure)


QUERY = """
select floor(time_s) as second, 3600 * degrees(sum(gyro_dtheta_rad)) as parity_dph
from 'tables/SENSOR_*.parquet' where time_s < 80 group by second order by second
"""
"""As the page shows it; the axes of the tetrahedron's four gyros add up to zero."""


def tables(folder: Path) -> None:
    """Draw what DuckDB answers about the tables."""
    subprocess.run(_rrins("export", "bus.log", "tables", "--json"), cwd=folder, check=True)
    figure = new_figure(7.5, 3.0)
    axes = figure.subplots()
    found = duckdb.sql(QUERY.replace("tables/", f"{folder}/tables/")).fetchnumpy()
    axes.plot(found["second"], found["parity_dph"], **LINES[0])
    finish(axes, "sum of all gyros / (°/h)")
    axes.set_xlabel(_SINCE)
    write_picture(TO / "tool_tables.png", figure)


def mcap(folder: Path) -> None:
    """Draw two topics of the MCAP file, as the format's own library reads them."""
    subprocess.run(_rrins("export", "bus.log", "bus.mcap", "--json"), cwd=folder, check=True)
    turns: dict[str, list[tuple[float, float]]] = {"body → gimbal": [], "gimbal → sensors": []}
    events: list[tuple[float, str]] = []
    with (folder / "bus.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(["/tf", "/events"]):
            content, time_s = json.loads(message.data), message.log_time / 1e9
            if channel.topic == "/events":
                events.append((time_s, content["message"]))
            elif (turn := content["rotation"])["y"] == 0.0:  # about x or z alone: an axis
                angle = 2 * np.degrees(np.arctan2(turn["x"] + turn["z"], turn["w"]))
                frames = f"{content['parent_frame_id']} → {content['child_frame_id']}"
                if frames in turns:
                    turns[frames].append((time_s, angle))
    figure = new_figure(7.5, 4.8)
    axes, words = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    for (frames, points), line in zip(turns.items(), LINES, strict=False):
        times_s, angles = np.array(points).T
        draw_line(axes, times_s, np.unwrap(angles, period=360), label=f"/tf {frames}", **line)
    for row, (time_s, text) in enumerate(events):
        words.plot(time_s, -row, "o", color="black", markersize=3, clip_on=False)
        side, aside = ("left", 4) if time_s < events[-1][0] / 2 else ("right", -4)
        words.annotate(
            textwrap.fill(text, 44), (time_s, -row), (aside, 0), textcoords="offset points",
            va="center", ha=side, fontsize="x-small",
        )  # fmt: skip
    words.set_yticks([])
    words.set_ylim(-len(events), 1)
    finish(axes, "turn / °")
    finish(words, "/events")
    legend_above(axes)
    words.set_xlabel(_SINCE)
    write_picture(TO / "tool_mcap.png", figure)


PICTURES = {one.__name__: one for one in (pdx, xcp, dialects, tables, mcap)}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        rehearse(Path(place))
        for name in sys.argv[1:] or PICTURES:
            PICTURES[name](Path(place))
