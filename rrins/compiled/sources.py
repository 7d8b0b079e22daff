"""The sources that compiled code is made of, and their digest.

A compiled function contains what it calls and the constants it names, wherever they stand. So a
file counts if it has a compiled function, or defines something that one refers to, directly or
through other definitions, or makes or loads the code. Comments, docstrings and layout do not
count: the digest is over syntax trees. A tree is read where it may count, and again if its file was
written since.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parent.parent
"""The package's folder; `dbc`, `firmware_py` and `host_tools` may be links in it."""

_CONTRACT = "dbc/rrins.dbc"
_COMPILERS = {"compiled", "compiled_with"}
_COMPILER = re.compile(rb"^[ \t]*@compiled", re.MULTILINE)
"""Is in every file that has a compiled function."""
_MAKERS = "compiled/"
"""Folder of what makes and loads code: all of it counts."""
_Stamp = list[int]


@dataclass(frozen=True)
class Facts:
    """Facts about a file that decide whether and how it counts."""

    tree: str  #: digest of its syntax tree
    compiled: list[str]  #: Top-level names that are compiled functions or contain one
    #: for each top-level name, the names its definition refers to; statements that define no name
    #: are under ``""``. An attribute of a name is ``name.attribute``.
    refers: dict[str, list[str]]
    imports: dict[str, list[str]]  #: for each imported name, its module and its name there


def stamp_of(path: str | Path) -> _Stamp | None:
    """Return when a file was written, and its size; None if there is no such file."""
    try:
        found = os.stat(path)  # noqa: PTH116 - called for each file at each start
    except OSError:
        return None
    return [found.st_mtime_ns, found.st_size]


class Sources:
    """All sources of the package.

    Parameters
    ----------
    folder : Path
        The package's folder.
    memory : Path, optional
        File that keeps the facts between runs; without it all files are read.
    """

    def __init__(self, folder: Path = PACKAGE, memory: Path | None = None) -> None:
        self._folder = folder
        self._stamps = {
            path: stamp for path in _files(folder) if (stamp := stamp_of(folder / path)) is not None
        }
        now = hashlib.sha256(repr(self._stamps).encode()).hexdigest()
        last = _recall(memory)
        if last.get("now") == now:
            self.digest = str(last["digest"])
            return
        facts_file = None if memory is None else memory.with_suffix(".facts")
        self._facts = self._known(_recall(facts_file))
        self.digest = self._digest_of(self.files())
        facts = {path: asdict(each) for path, each in self._facts.items()}
        _remember(facts_file, {"stamps": self._stamps, "facts": facts})
        _remember(memory, {"now": now, "digest": self.digest})

    def is_as_digested(self, path: str, stamp: object) -> bool:
        """Return whether a file's stamp is that of the content that the digest is over."""
        with suppress(ValueError):
            return self._stamps.get(Path(path).relative_to(self._folder).as_posix()) == stamp
        return False

    def files(self) -> list[str]:
        """Return the files that count, relative to the folder."""
        modules = {_module_of(path): path for path in self._stamps if path != _CONTRACT}
        waiting = [
            (path, name)
            for path in modules.values()
            if path in self._facts or _COMPILER.search((self._folder / path).read_bytes())
            for name in self._facts_of(path).compiled
        ]
        found = set(waiting)
        while waiting:
            path, name = waiting.pop()
            new = set(self._references(modules, path, name)) - found
            found |= new
            waiting += new
        makers = {path for path in self._stamps if path.startswith(_MAKERS)}
        return sorted({path for path, _ in found} | makers)

    def _references(
        self, modules: dict[str, str], path: str, name: str
    ) -> Iterator[tuple[str, str]]:
        """Return what the definition of a name refers to, as files and names."""
        facts = self._facts_of(path)
        for reference in (*facts.refers.get(name, ()), *facts.refers.get("", ())):
            first, _, attribute = reference.partition(".")
            if first in facts.refers:
                yield path, first
            elif first in facts.imports:
                module, imported = facts.imports[first]
                if (whole := modules.get(f"{module}.{imported}")) is not None:
                    yield whole, attribute
                elif module in modules:
                    yield modules[module], imported
        if name in facts.imports:  # passed on from a third module
            module, imported = facts.imports[name]
            if module in modules:
                yield modules[module], imported

    def _known(self, kept: dict[str, Any]) -> dict[str, Facts]:
        """Return the facts about the files that were not written since."""
        stamps, facts = kept.get("stamps", {}), kept.get("facts", {})
        return {
            path: Facts(**facts[path])
            for path, stamp in self._stamps.items()
            if path in facts and stamps.get(path) == stamp
        }

    def _facts_of(self, path: str) -> Facts:
        if path not in self._facts:
            self._facts[path] = facts_of((self._folder / path).read_bytes())
        return self._facts[path]

    def _digest_of(self, files: list[str]) -> str:
        digest = hashlib.sha256((self._folder / _CONTRACT).read_bytes())
        for path in files:
            digest.update(f"{path} {self._facts_of(path).tree}\n".encode())
        return digest.hexdigest()[:16]


def facts_of(source: bytes) -> Facts:
    """Return the facts about a file's content."""
    tree = ast.parse(source)
    compiled, refers, imports = set(), dict[str, set[str]](), dict[str, list[str]]()
    for statement in tree.body:
        nodes = list(_walk(statement))
        names = _defined_by(statement, nodes) or [""]
        references = _references_in(statement, nodes)
        for name in names:
            refers.setdefault(name, set()).update(references)
        if any(_is_compiled(node) for node in nodes):
            compiled.update(names)
        for node in nodes:
            if isinstance(node, ast.ImportFrom):
                module = (node.module or "").removeprefix("rrins.")
                found = {each.asname or each.name: [module, each.name] for each in node.names}
                imports.update(found)
            _drop_docstring(node)
    _drop_docstring(tree)
    return Facts(
        hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16],
        sorted(compiled),
        {name: sorted(references) for name, references in refers.items()},
        imports,
    )


def _walk(statement: ast.AST) -> Iterator[ast.AST]:
    """Return a statement and all that it contains, in a third of the time of `ast.walk`."""
    waiting = [statement]
    while waiting:
        node = waiting.pop()
        yield node
        for value in vars(node).values():
            if isinstance(value, ast.AST):
                waiting.append(value)
            elif isinstance(value, list):
                waiting += (each for each in value if isinstance(each, ast.AST))


def _defined_by(statement: ast.stmt, nodes: list[ast.AST]) -> list[str]:
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        return sorted(_set_in(nodes))
    return []


def _references_in(statement: ast.stmt, nodes: list[ast.AST]) -> set[str]:
    """Return the names that a statement reads and a function does not set itself.

    An attribute of one is ``name.attribute``.
    """
    own: set[str] = set()
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
        own = _set_in(nodes) | {node.arg for node in nodes if isinstance(node, ast.arg)}
    return {name for name in _read_in(nodes) if name.partition(".")[0] not in own}


def _set_in(nodes: list[ast.AST]) -> set[str]:
    return {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def _read_in(nodes: list[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id


def _is_compiled(node: ast.AST) -> bool:
    if not isinstance(node, ast.FunctionDef):
        return False
    plain = (each.func if isinstance(each, ast.Call) else each for each in node.decorator_list)
    return any(isinstance(each, ast.Name) and each.id in _COMPILERS for each in plain)


def _drop_docstring(node: ast.AST) -> None:
    """Take string statements out of a body: docstrings of definitions and of constants."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        node.body = [each for each in node.body if not _is_text(each)]


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def _files(folder: Path) -> Iterator[str]:
    """Return the sources in a folder, relative to it."""
    for path, folders, names in os.walk(folder, followlinks=True):
        folders[:] = sorted(name for name in folders if not name.startswith(("__", ".")))
        inside = os.path.relpath(path, folder)
        prefix = "" if inside == "." else f"{inside}/"
        yield from (f"{prefix}{name}" for name in sorted(names) if name.endswith(".py"))
    yield _CONTRACT


def _module_of(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _recall(memory: Path | None) -> dict[str, Any]:
    """Return what was kept; nothing if there is none, or if it is damaged."""
    with suppress(OSError, ValueError):
        if memory is not None and memory.stat().st_uid == os.geteuid():
            checksum, _, text = memory.read_bytes().partition(b"\n")
            if checksum == _checksum(text):
                return dict(json.loads(text))
    return {}


def _remember(memory: Path | None, kept: dict[str, Any]) -> None:
    """Keep facts for the next start; where that fails, it reads all files again."""
    if memory is None:
        return
    text = json.dumps(kept).encode()
    with suppress(OSError):
        memory.parent.parent.mkdir(parents=True, exist_ok=True)
        memory.parent.mkdir(mode=0o700, exist_ok=True)
        descriptor, unfinished = tempfile.mkstemp(dir=memory.parent)
        with os.fdopen(descriptor, "wb") as file:
            file.write(_checksum(text) + b"\n" + text)
        Path(unfinished).replace(memory)


def _checksum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode()
