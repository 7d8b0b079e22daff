"""`rrins xcp` as a user types it, beside a rehearsal in lockstep."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pyxcp")

from rrins.firmware_py.xcp.a2l import a2l_text
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import open_when_there
from rrins.host_tools.cli.main import rrins
from tests.processes import Fork

START_S = 300


@dataclass
class Desk:
    """A terminal beside a rehearsal."""

    channel: str
    folder: Path

    def type(self, *words: str) -> Result:
        """Type a command of `rrins xcp`; return what comes of it."""
        bus = ["--channel", self.channel, "--timeout", "60"]
        return CliRunner().invoke(rrins, ["xcp", *words, *bus], prog_name="rrins")


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """Return the terminal that the tests of this file share; it names the channel by its path."""
    folder = tmp_path_factory.mktemp("desk")
    (folder / "measured.toml").write_text("duration_s = 20000.0\n[xcp]\n")
    with tempfile.TemporaryDirectory(prefix="rrins-") as runtime:
        channel = f"{runtime}/rrins/desk.sock"
        words = ["rehearse", str(folder / "measured.toml"), "--channel", "desk", "--speed", "10"]
        process = Fork(
            ["rrins", *words, "--json", "--out", str(folder / "out")],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"XDG_RUNTIME_DIR": runtime},
        )
        try:
            there = {"host": "never", "role": "observer", "name": "first"}
            open_when_there(Address("rrins", channel), START_S, **there).shutdown()
            yield Desk(channel, folder)
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(START_S)


def test_a_parameter_is_written_within_its_limits_until_power_off(desk):
    name = "parameters.follow_tolerance_deg"
    assert desk.type("write", name, "2.5").output == f"{name}: 5, now 2.5\n"
    assert desk.type("read", name, "--json").output == '{"parameters.follow_tolerance_deg": 2.5}\n'
    refused = desk.type("write", name, "400")
    assert (refused.exit_code, refused.stdout) == (25, "")
    assert refused.stderr == f"rrins: signal {name}: 400 is not from 0.001 to 180\n"


def test_values_are_shown_in_words(desk):
    shown = desk.type("read", "gyros.calibrated", "sequencer.command[1]").output.split()
    assert shown[:2] == ["gyros.calibrated", "no"]
    assert shown[3].isupper()


def test_an_array_cannot_be_written_at_once(desk):
    refused = desk.type("write", "gyros.bias_increment", "0")
    assert refused.exit_code == 25
    assert "name one of its elements, as gyros.bias_increment[0]" in refused.stderr


def test_a_recording_is_as_long_as_was_asked(desk):
    out = desk.folder / "epochs.csv"
    said = desk.type("record", str(out), "epoch", "--for", "1.5", "--every", "2")
    assert said.output == f"{out}: 150 samples of 1 signals, bus load 2.7 %\n"
    epochs = [int(line.split(",")[1]) for line in out.read_text().splitlines()[1:]]
    assert [b - a for a, b in itertools.pairwise(epochs)] == [2] * 149


def test_the_a2l_of_the_computer_is_that_of_the_scenario(desk):
    fetched, made = desk.folder / "fetched.a2l", desk.folder / "made.a2l"
    assert desk.type("a2l", str(fetched)).exit_code == 0
    scenario = str(desk.folder / "measured.toml")
    assert desk.type("a2l", str(made), "--scenario", scenario).exit_code == 0
    assert fetched.read_text() == made.read_text() == a2l_text(5_000_000)


def test_nobody_there_is_told(tmp_path):
    nobody = Desk("nobody", tmp_path)
    assert nobody.type("read", "epoch").exit_code == 4
