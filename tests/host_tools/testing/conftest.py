"""Pytest runs of a user, in a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from tests.processes import Fork


class Run:
    """A pytest run that has ended."""

    def __init__(self, arguments, folder):
        command = Fork(
            ["pytest", "-p", "no:cacheprovider", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env={k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")},
        )
        self.text, _ = command.communicate()
        self.status = command.returncode

    def count(self, outcome):
        found = re.search(rf"(\d+) {outcome}", self.text.splitlines()[-1])
        return int(found[1]) if found else 0


@pytest.fixture
def run_in(tmp_path):
    """Run pytest in a folder, its temporary files under the test's own."""

    def run(folder, *arguments):
        return Run([*arguments, "--basetemp", str(tmp_path / "basetemp")], folder)

    return run


@pytest.fixture
def run_test(run_in, tmp_path):
    """Run the text of a test file."""

    def run(text, *arguments):
        folder = tmp_path / "project"
        folder.mkdir()
        (folder / "pytest.ini").write_text("[pytest]\n")
        (folder / "test_own.py").write_text(text)
        return run_in(folder, *arguments)

    return run
