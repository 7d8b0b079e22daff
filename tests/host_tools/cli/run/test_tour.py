"""`rrins tour`: the story in the terminal, and its steps for the page."""

from __future__ import annotations

import re
import shlex
import webbrowser
from importlib import resources

import click
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.dashboard.tour import FAULT, STEPS, told
from rrins.host_tools.scenario.scenario import fault_of


@pytest.mark.slow
def test_the_terminal_tells_it_with_the_figures_of_the_run(monkeypatch):
    def no_browser(using=None):
        raise webbrowser.Error("none")

    monkeypatch.setattr(webbrowser, "get", no_browser)
    said = CliRunner().invoke(rrins, ["tour"])
    assert said.exit_code == 0, said.output
    assert "no browser here: the tour in the terminal" in said.output
    standing, turning = map(float, re.findall(r"([\d.]+) m at rest, ([\d.]+) m", said.output)[0])
    assert standing > 10 * turning
    assert re.search(r"left out after \d+ s", said.output)
    assert "C1103-64  gyro_3_left_out" in said.output
    assert "Why the position is off by" in said.output
    assert max(map(len, said.output.splitlines())) <= 80


def test_each_step_has_a_command_that_is_one_and_a_place_that_is_on_the_page():
    page = resources.files("rrins.host_tools.dashboard").joinpath("page")
    text = page.joinpath("index.html").read_text() + page.joinpath("plots.js").read_text()
    for step in told():
        words = shlex.split(step["command"])
        found = rrins.get_command(click.Context(rrins), words[1])
        assert words[0] == "rrins"
        assert found is not None
        id_or_class = step["look"].removeprefix("#plot-").lstrip("#.")
        assert id_or_class in text
    assert fault_of(dict(FAULT)).kind == "gyro_ramp"
    assert sum(bool(step.until_s or step.until_event) for step in STEPS) == 3
