"""The page on the diagnostic table is that of the table."""

from __future__ import annotations

from pathlib import Path

from generate.diagnostic_page import page


def test_the_page_in_docs_is_current():
    path = Path(__file__).parents[2] / "docs" / "diagnostic-table.md"
    assert path.read_text(encoding="utf-8") == page(), "run `make docs`"
