"""The tests that a user starts from pass, whatever way they are run."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture
def own_tests(tmp_path):
    """A copy, so that nothing is written beside the original."""
    return shutil.copytree(
        EXAMPLES / "own_tests", tmp_path / "own_tests", ignore=shutil.ignore_patterns("__pycache__")
    )


def test_in_the_direct_way(run_in, own_tests):
    run = run_in(own_tests)
    assert run.status == 0, run.text
    assert run.count("passed") == 5


def test_one_of_them_in_lockstep(run_in, own_tests):
    run = run_in(own_tests, "--rrins-way", "lockstep", "-k", "silent_axis")
    assert run.status == 0, run.text
    assert run.count("passed") == 1
