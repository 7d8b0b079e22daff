"""The tables of keys in the docs are those of the code."""

from __future__ import annotations

from generate.scenario_tables import PAGE, page, tables


def test_the_tables_in_docs_are_current():
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(text), "run `make docs`"


def test_every_key_says_what_it_means():
    rows = [row for table in tables().values() for row in table.splitlines()[2:]]
    assert [row for row in rows if row.endswith("| |")] == []
