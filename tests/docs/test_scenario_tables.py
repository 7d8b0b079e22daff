"""The tables of keys in the docs, and the types that editors read, are those of the code."""

from __future__ import annotations

import subprocess
import sys

from generate.scenario_keys import STUB, text
from generate.scenario_tables import PAGE, page, tables


def test_the_tables_in_docs_are_current():
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(text), "run `make docs`"


def test_every_key_says_what_it_means():
    rows = [row for table in tables().values() for row in table.splitlines()[2:]]
    assert [row for row in rows if row.endswith("| |")] == []


def test_editors_read_the_keys_of_the_code():
    formatted = subprocess.run(
        [sys.executable, "-m", "ruff", "format", f"--stdin-filename={STUB}", "-"],
        input=text(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert STUB.read_text(encoding="utf-8") == formatted.stdout, "run `make docs`"
