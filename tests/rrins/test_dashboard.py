"""The dashboard from Python: served while the block lasts."""

from __future__ import annotations

import sys
import urllib.error
import urllib.request

import pytest

import rrins

pytest.importorskip("uvicorn")


def test_it_is_served_beside_the_script_and_then_gone(tmp_path):
    before = sys.getswitchinterval()
    with rrins.open_dashboard("ideal", duration_s=5, out=tmp_path / "out") as page:
        assert page.url in page._repr_html_()
        with urllib.request.urlopen(page.url) as answer:
            assert b"<title>" in answer.read()
    assert sys.getswitchinterval() == before
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.url)


def test_what_cannot_be_shown_is_one_line():
    with (
        pytest.raises(rrins.RehearsalError, match="rimu_rotatin"),
        rrins.open_dashboard("rimu_rotatin"),
    ):
        pass
