"""The page on the bus contract is that of the DBC."""

from __future__ import annotations

from pathlib import Path

from generate.contract_page import page


def test_the_page_in_docs_is_current():
    path = Path(__file__).parents[2] / "docs" / "bus-contract.md"
    assert path.read_text(encoding="utf-8") == page(), "run `make docs`"
