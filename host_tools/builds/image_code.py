"""Memories at power-on as code: constants, and functions that write them into blank memory."""

from __future__ import annotations

import re
from collections.abc import Iterator

_GAP = 32
"""Zeros in a row that are worth the end of one run and the start of another."""
_RUN = re.compile(rb"[^\0](?:.{0,%d}?[^\0])*" % _GAP, re.DOTALL)


DECLARATIONS = """\
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""
"""To stand once in a module with a function of `power_on`."""


def constant(name: str, value: bytes) -> str:
    """Return a constant of some bytes as LLVM's text, under its name in C."""
    return f"@{name} = constant [{len(value)} x i8] {_literal(value)}, align 8\n"


def number(name: str, value: int) -> str:
    """Return a constant ``int32_t`` as LLVM's text."""
    return f"@{name} = constant i32 {value}\n"


def power_on(name: str, memory: bytes) -> str:
    """Return ``void name(void *memory)`` as LLVM's text: it makes the memory what it is here."""
    values: list[str] = []
    copies: list[str] = []
    for k, (offset, run) in enumerate(_runs(memory)):
        values.append(f"@{name}.{k} = internal constant [{len(run)} x i8] {_literal(run)}")
        copies.append(
            f"  %at.{k} = getelementptr i8, ptr %memory, i64 {offset}\n"
            f"  call void @llvm.memcpy.p0.p0.i64("
            f"ptr %at.{k}, ptr @{name}.{k}, i64 {len(run)}, i1 0)"
        )
    return "\n".join(
        (
            *values,
            f"define void @{name}(ptr %memory) {{",
            f"  call void @llvm.memset.p0.i64(ptr %memory, i8 0, i64 {len(memory)}, i1 0)",
            *copies,
            "  ret void",
            "}",
            "",
        )
    )


def _runs(memory: bytes) -> Iterator[tuple[int, bytes]]:
    """Return the stretches that are not blank, with their offsets."""
    return ((found.start(), found[0]) for found in _RUN.finditer(memory))


def _literal(value: bytes) -> str:
    return 'c"' + "".join(f"\\{byte:02X}" for byte in value) + '"'
