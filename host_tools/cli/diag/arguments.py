"""Argument types with completion: data identifiers, routines, trouble codes."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from typing import Any, Generic, Protocol, TypeVar

import click
from click.shell_completion import CompletionItem

from rrins.firmware_py.core.records.troubles import Trouble
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.routines import Routine
from rrins.host_tools.diag import ram


class _Thing(Protocol):
    @property
    def number(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...


_T = TypeVar("_T", bound=_Thing)


class _Named(click.ParamType, Generic[_T]):  # type: ignore[type-arg]  # generic in new clicks
    """An entry of the diagnostic table, by name or number."""

    def __init__(
        self, name: str, kind: str, things: Iterable[_T], takes: Callable[[_T], bool], lack: str
    ) -> None:
        self.name = name
        self._kind = kind
        self._all = tuple(things)
        self._takes = takes
        self._lack = lack

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> _T:
        """Return the entry; fail in one line if there is none."""
        if not isinstance(value, str):
            return value
        found = self._find(value)
        if found is None:
            names = [thing.name for thing in self._all if self._takes(thing)]
            close = difflib.get_close_matches(value, names, 3)
            hint = f"; did you mean {' or '.join(close)}?" if close else ""
            self.fail(f"there is no {self._kind} {value!r}{hint}", param, ctx)
        if not self._takes(found):
            self.fail(f"{found.name} {self._lack}", param, ctx)
        return found

    def _find(self, text: str) -> _T | None:
        number = int(text, 16) if text.lower().startswith("0x") and _is_hex(text[2:]) else None
        for thing in self._all:
            code = getattr(thing, "code", None)
            if thing.name == text or thing.number == number or (code and code == text.upper()):
                return thing
        return None

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that start with `incomplete`."""
        return [
            CompletionItem(thing.name, help=thing.text)
            for thing in self._all
            if self._takes(thing) and thing.name.startswith(incomplete)
        ]


def _is_hex(text: str) -> bool:
    return bool(text) and all(one in "0123456789abcdefABCDEF" for one in text)


def _any(thing: object) -> bool:
    return True


IDENTIFIER = _Named[DataIdentifier]("identifier", "data identifier", table.IDENTIFIERS, _any, "")
WRITABLE = _Named[DataIdentifier](
    "identifier",
    "data identifier",
    table.IDENTIFIERS,
    lambda did: did.write is not None,
    "cannot be written; see `rrins diag did list --writable`",
)
CONTROLLABLE = _Named[DataIdentifier](
    "identifier",
    "data identifier",
    table.IDENTIFIERS,
    lambda did: did.control is not None,
    "cannot be controlled; see `rrins diag did list --controllable`",
)
ROUTINE = _Named[Routine]("routine", "routine", table.ROUTINES, _any, "")
STOPPABLE = _Named[Routine](
    "routine", "routine", table.ROUTINES, lambda routine: routine.can_stop, "cannot be stopped"
)
TROUBLE = _Named[Trouble]("trouble", "trouble code", table.TROUBLES, _any, "")


def _fields(fields: Iterable[Field], incomplete: str) -> list[CompletionItem]:
    name, equals, begun = incomplete.partition("=")
    items = []
    for field in fields:
        if equals and field.name == name and field.choices is not None:
            items += [
                CompletionItem(f"{name}={choice.name}")
                for choice in field.choices
                if choice.name.startswith(begun.upper())
            ]
        elif not equals and field.name.startswith(incomplete):
            items.append(CompletionItem(f"{field.name}=", help=field.text))
    return items


def complete_values(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return ``FIELD=`` and its named values, for the preceding identifier."""
    did = ctx.params.get("did")
    return _fields(did.fields, incomplete) if isinstance(did, DataIdentifier) else []


def complete_arguments(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return ``ARGUMENT=`` and its named values, for the preceding routine."""
    routine = ctx.params.get("routine")
    return _fields(routine.arguments, incomplete) if isinstance(routine, Routine) else []


def complete_memory(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return the fields of the RAM image one level down; a dot marks those with subfields."""
    paths = ram.paths_below(incomplete)
    below = [f"{path}." for path in paths if ram.paths_below(f"{path}.")]
    return [CompletionItem(path) for path in (*paths, *below)]
