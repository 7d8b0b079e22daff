"""A scenario of a test's own."""

from __future__ import annotations

import pytest


@pytest.fixture
def write(tmp_path):
    def writer(text):
        path = tmp_path / "own.toml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return writer
