"""The table of rooms in the docs is that of the contracts."""

from __future__ import annotations

from generate.rooms_table import GUIDES, PAGE, ROOT, levels, page


def test_the_table_in_docs_is_current():
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(text), "run `make docs`"


def test_every_room_stands_in_the_table():
    rooms = {name for level in levels() for name in level}
    there = {
        f"rrins.{package}.{path.stem}"
        for package in ("firmware_py", "host_tools")
        for path in (ROOT / package).iterdir()
        if not path.name.startswith("__")
    }
    assert rooms == there | {"rrins.dbc", "rrins.compiled"}


def test_the_guides_are_there():
    for room, guide in GUIDES.items():
        assert (ROOT / room).exists(), room
        assert (PAGE.parent / guide).is_file(), guide
