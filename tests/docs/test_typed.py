"""Commands in the guides give the output that the guides show.

With RRINS_WRITE_DOCS set, the pages are written anew with what comes.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (
    "first-half-hour.md",
    "something-is-wrong.md",
    "diag.md",
    "redundancy-study.md",
    "tolerances.md",
    "files-for-tools.md",
)
IS_WRITING = "RRINS_WRITE_DOCS" in os.environ

_NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?|-?\d+")
_CRC = re.compile(r"CRC (?:0x)?[0-9A-F]{8}")
_SCENARIO = re.compile(r"^```toml\n# (\w+\.toml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_BLOCK = re.compile(r"(?<=^```console\n).*?(?=^```$)", re.MULTILINE | re.DOTALL)


def close(shown: float, said: float) -> bool:
    """Return whether two numbers differ by 1 % at most, or by what rounding may leave."""
    return shown == pytest.approx(said, rel=0.01, abs=1e-5)


def same(shown: str, said: str) -> bool:
    """Return whether two texts are the same; fractions may differ a little, and their CRC."""
    shown, said = _CRC.sub("CRC", shown), _CRC.sub("CRC", said)
    if _NUMBER.sub("#", shown) != _NUMBER.sub("#", said):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(said), strict=True)
    return all(a == b or ("." in a and close(float(a), float(b))) for a, b in pairs)


def retyped(block: str, type_command) -> str:
    """Return a console block with what its commands say now."""
    lines = []
    for command in re.findall(r"^\$ (.*)$", block, re.MULTILINE):
        lines += [f"$ {command}", *type_command(command).splitlines()]
    return "".join(line.rstrip() + "\n" for line in lines)


@pytest.mark.typed
@pytest.mark.parametrize("name", PAGES)
def test_what_a_guide_shows_is_what_is_said(desk, name):
    page = DOCS / name
    text = page.read_text()
    for scenario, keys in _SCENARIO.findall(text):
        Path(scenario).write_text(keys)
    said = _BLOCK.sub(lambda found: retyped(found[0], desk.type), text)
    if IS_WRITING:
        page.write_text(said)
        return
    for shown_line, said_line in zip(text.splitlines(), said.splitlines(), strict=False):
        assert same(shown_line, said_line)
    assert text.count("\n") == said.count("\n")
