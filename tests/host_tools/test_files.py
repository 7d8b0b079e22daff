"""Files that are none, have no end or are too large: one line at once, whatever reads them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.files import LARGEST_TOML, content_of, text_of

INPUTS = {
    "scenario": (("simulate", "{}"), 3),
    "scheme": (("scheme", "analyse", "{}"), 3),
    "errors": (("scheme", "analyse", "16-position", "--errors", "{}"), 3),
    "geometry": (("scheme", "analyse", "16-position", "--rimu", "{}"), 3),
    "motion": (("motion", "check", "{}"), 9),
    "calibration": (("simulate", "names_it.toml"), 3),
    "log": (("plot", "{}", "--list"), 6),
}
NAMES = {"motion": "input.csv", "log": "input.log"}


@pytest.fixture(autouse=True)
def _in_a_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(params=INPUTS)
def refused(request):
    """Return a function that gives a command one bad file and returns what it says."""
    arguments, status = INPUTS[request.param]
    path = Path(NAMES.get(request.param, "input.toml")).absolute()

    def run(make):
        make(path)
        Path("names_it.toml").write_text(
            f'duration_s = 1\n[firmware]\ncalibration = "{path.name}"\n', encoding="utf-8"
        )
        ended = CliRunner().invoke(rrins, [word.format(path.name) for word in arguments])
        assert isinstance(ended.exception, SystemExit), ended
        (said,) = [line for line in ended.stderr.splitlines() if line.startswith("rrins: ")]
        assert ended.exit_code == status, said
        assert path.name in said
        return said

    return run


def test_a_pipe_without_a_writer(refused):
    assert "file" in refused(os.mkfifo)


def test_a_device_without_an_end(refused):
    assert "file" in refused(lambda path: path.symlink_to("/dev/zero"))


@pytest.mark.parametrize("refused", sorted(INPUTS.keys() - {"log"}), indirect=True)
def test_a_file_of_gigabytes(refused):
    def make(path):
        with path.open("wb") as file:
            file.truncate(1 << 33)

    assert "is larger than 1 " in refused(make)


def test_a_file_is_read_whole_and_a_mark_of_its_encoding_left_out(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"\xef\xbb\xbf" + b"x" * (LARGEST_TOML - 3))
    assert len(content_of(path, LARGEST_TOML)) == LARGEST_TOML
    assert text_of(path) == "x" * (LARGEST_TOML - 3)
    path.write_bytes(b"\xff")
    with pytest.raises(OSError, match="is not UTF-8 text"):
        text_of(path)
