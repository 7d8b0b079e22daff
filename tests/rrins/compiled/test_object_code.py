"""Intermediate code that serves every processor."""

from __future__ import annotations

import re

from rrins.compiled.compilation import compiled
from rrins.compiled.object_code import Argument, Entry, intermediate_code
from rrins.compiled.record import Floats


@compiled
def _one_of(one: Floats, other: Floats, which: int) -> Floats:
    return other if which else one


@compiled
def _pick(one: Floats, other: Floats, which: int) -> int:
    return int(_one_of(one, other, which)[0])


def test_pointers_in_structs_have_no_place_yet():
    """Those of 32 bits have another: code that knows the place is that of one processor."""
    numbers = [Argument(name, float, (3,)) for name in ("one", "other")]
    text = intermediate_code([Entry("pick", _pick, (*numbers, Argument("which", int)))])
    assert re.search(r"store \{ ptr, ptr, i64, i64, ptr, .* ptr %retptr", text)
    assert not re.search(r"getelementptr .*i8, ptr %retptr", text)
