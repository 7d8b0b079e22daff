"""Writes the types of a scenario's keys for editors: ``python -m generate.scenario_keys``.

`host_tools/scenario/typed_keys.pyi` has a `TypedDict` for each table, one for all keywords of a
call, and those of faults.
"""

from __future__ import annotations

import subprocess
import sys
import textwrap
import types
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from rrins.host_tools.hardware.tables import PerSensor
from rrins.host_tools.scenario.fault_tables import KINDS, FaultOfHardware, FaultOnWire
from rrins.host_tools.scenario.keywords import keywords, paths
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schema import description
from rrins.host_tools.scenario.wrong_keys import tables_in

STUB = Path(__file__).resolve().parents[2] / "host_tools" / "scenario" / "typed_keys.pyi"
_HEAD = '''\
"""Keys of scenarios and faults as type checkers and editors read them; by `make docs`."""

from collections.abc import Sequence
from typing import Any, Literal, Required, TypedDict

from numpy.typing import NDArray

PerSensor = float | Sequence[float] | NDArray[Any]
'''
_WIDTH = 100
_CALLS = {
    "SharedKeys": ((), "Keywords of every call that takes a scenario."),
    "TimedKeys": (("duration_s",), "The same, with the duration."),
    "RunKeys": (("seed", "faults"), "The same, with all that a run needs."),
    "ScenarioKeys": (("kind", "bitrate"), "All keys of a scenario as keywords."),
}
"""Keywords by call: one that a call has itself, such as `seed`, is apart."""
_APART = {key for keys, _ in _CALLS.values() for key in keys}


def _type(annotation: Any) -> str:
    """Return a key's type as a caller may write its value."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(parts[0])
    if origin is Literal:
        return f"Literal[{', '.join(map(repr, parts))}]".replace("'", '"')
    if origin is tuple:
        return f"Sequence[{_type(parts[0])}]"
    if origin in (Union, types.UnionType):
        if any(issubclass(one, _FAULTS) for one in parts if isinstance(one, type)):
            return "FaultTable"
        words = " | ".join(dict.fromkeys(map(_type, parts)))
        return words.replace(_type_of_each, "PerSensor")
    if annotation is type(None):
        return "None"
    return (
        f"{annotation.__name__}Table" if issubclass(annotation, BaseModel) else annotation.__name__
    )


_FAULTS = (FaultOnWire, FaultOfHardware)
_type_of_each = " | ".join(map(_type, get_args(PerSensor)))


def _tables(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield the tables in a table and in those, innermost first; no faults."""
    for field in table.model_fields.values():
        for one in tables_in(field.annotation, in_arrays=True):
            if not issubclass(one, _FAULTS):
                yield from _tables(one)
                yield one


@cache
def _with_bases(table: type[BaseModel]) -> tuple[type[BaseModel], ...]:
    """Return all tables, each behind those from which it takes keys."""
    found = [one for table in _tables(table) for one in reversed(table.__mro__)]
    return tuple(dict.fromkeys(one for one in found if getattr(one, "model_fields", {})))


def _class(
    name: str, bases: Iterable[str], meaning: str, keys: Mapping[str, tuple[str, str]]
) -> str:
    """Return a `TypedDict`; a key has a type and a meaning."""
    above = ", ".join(bases) or "TypedDict"
    lines = [f"class {name}({above}, total=False):", f'    """{meaning}"""', ""]
    for key, (kind, words) in keys.items():
        lines += [f"    {key}: {kind}", *(_wrapped(words) if words else [])]
    return "\n".join(lines) + "\n"


def _wrapped(words: str) -> list[str]:
    return textwrap.wrap(f'"""{words}"""', _WIDTH, initial_indent="    ", subsequent_indent="    ")


def _of_table(table: type[BaseModel]) -> tuple[str, str]:
    """Return the classes of a table, and which of them has the keys that calls have, too.

    What tables share is in their common base. Keys that calls have by the same name are in a class
    of their own, if the table has others as well.
    """
    above = [f"{one.__name__}Table" for one in table.__bases__ if one in _with_bases(Scenario)]
    own = {key: field for key, field in table.model_fields.items() if _declares(table, key)}
    of_calls = {key: own.pop(key) for key in tuple(own) if (table, key) in _of_calls()}
    name = f"{table.__name__}Table"
    shared = f"_{table.__name__}Keys" if own or above else name
    written = []
    if of_calls:
        keys = {k: (_type(f.annotation), description(table, k)) for k, f in of_calls.items()}
        written.append(_class(shared, [], f"Keys of `{table.__name__}` and of calls.", keys))
        above.append(shared)
    if name not in above:
        keys = {key: (_type(field.annotation), "") for key, field in own.items()}
        written.append(_class(name, above, f"Keys of `{table.__name__}`.", keys))
    return "\n".join(written), shared if of_calls else ""


def _declares(table: type[BaseModel], key: str) -> bool:
    return key in vars(table).get("__annotations__", {})


@cache
def _of_calls() -> set[tuple[type[BaseModel], str]]:
    """Return the keys that are a keyword of all calls by their own name, and who declares them."""
    found = set()
    for name, path in keywords().items():
        if path.endswith(f"__{name}") and name not in _APART:
            declaring = next(one for one in paths()[path][0].__mro__ if _declares(one, name))
            found.add((declaring, name))
    return found


def _of_path(path: str) -> tuple[str, str]:
    table, field = paths()[path]
    return _type(field.annotation), description(table, path.rpartition("__")[2])


def _of_faults() -> Iterator[str]:
    keys: dict[str, tuple[str, str]] = {}
    for table in dict.fromkeys(KINDS.values()):
        for key, field in table.model_fields.items():
            keys.setdefault(key, (_type(field.annotation), description(table, key)))
    del keys["kind"]
    begins = keys.pop("at_s")
    kinds = "".join(f'    "{kind}",\n' for kind in KINDS)
    yield f"FaultKind = Literal[\n{kinds}]\n"
    yield _class("FaultKeys", [], "Keys of a fault; each kind has some.", keys)
    yield _class(
        "FaultTable",
        ["FaultKeys"],
        "A fault of a scenario.",
        {"kind": ("Required[FaultKind]", ""), "at_s": begins},
    )


def text() -> str:
    """Return the stub."""
    long = {path: (_type(f.annotation), "") for path, (_, f) in paths().items() if "__" in path}
    classes = [_class("_Paths", [], "Keys with their tables.", long)]
    tables, shared = zip(*map(_of_table, _with_bases(Scenario)), strict=True)
    bases = ["_Paths", *filter(None, shared)]
    for name, (added, meaning) in _CALLS.items():
        own = added or (key for key, path in keywords().items() if not path.endswith(f"__{key}"))
        some = {key: _of_path(keywords()[key]) for key in own if key in added or key not in _APART}
        classes.append(_class(name, bases, meaning, some))
        bases = [name]
    return "\n".join([_HEAD, *_of_faults(), *tables, *classes])


if __name__ == "__main__":
    STUB.write_text(text(), encoding="utf-8")
    subprocess.run([sys.executable, "-m", "ruff", "format", "--quiet", str(STUB)], check=True)
