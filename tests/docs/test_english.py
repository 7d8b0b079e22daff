"""The dialect that CONTRIBUTING.md rules out does not come back."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("rrins", "dbc", "firmware_py", "host_tools", "docs", "examples")

_RULED_OUT = {
    "is no …": re.compile(
        r"(?<![Tt]here )(?<!that )\b(?:is|are) no (?!longer\b|more\b|one\b|less\b)"
    ),
    "What … as a docstring": re.compile(r'^ *"""What(?!.*\?)', re.MULTILINE),
    "another language": re.compile(r"speaks another language"),
}


def test_no_sentence_is_in_the_dialect():
    found = []
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for name, pattern in _RULED_OUT.items():
            lines = [text.count("\n", 0, hit.start()) + 1 for hit in pattern.finditer(text)]
            found += [f"{path.relative_to(ROOT)}:{line}: {name}" for line in lines]
    assert not found
