"""How much the checks find: small changes to a firmware in C, each of which a check should find."""

from __future__ import annotations

import hashlib
import os
import random
import re
import shlex
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from rrins.host_tools.closing import Closing
from rrins.host_tools.conformance.check import Check
from rrins.host_tools.conformance.suite import conform
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject

_BUILD_S: Final = 300.0

_OPERATORS: Final[tuple[tuple[re.Pattern[str], tuple[str, ...]], ...]] = (
    (re.compile(r"(?<=[^<>=!-])<(?=[^<=])(?![a-z/_.]+\.h>)"), ("<=", ">=")),
    (re.compile(r"(?<=[^<>=!-])>(?=[^>=])"), (">=", "<=")),
    (re.compile(r"<="), ("<",)),
    (re.compile(r"(?<!>)>=(?!=)"), (">",)),
    (re.compile(r"=="), ("!=",)),
    (re.compile(r"!="), ("==",)),
    (re.compile(r"&&"), ("||",)),
    (re.compile(r"\|\|"), ("&&",)),
    (re.compile(r"(?<=[\w)\]] )\+(?= [\w(*&-])"), ("-",)),
    (re.compile(r"(?<=[\w)\]] )-(?= [\w(*&-])"), ("+",)),
    (re.compile(r"(?<=[\w)\]] )\*(?= [\w(&-])"), ("/",)),
    (re.compile(r"(?<=[\w)\]] )/(?= [\w(&-])"), ("*",)),
    (re.compile(r"\+="), ("-=",)),
    (re.compile(r"-="), ("+=",)),
    (re.compile(r"\btrue\b"), ("false",)),
    (re.compile(r"\bfalse\b"), ("true",)),
)
_NUMBER: Final = re.compile(
    r"(?<![\w.\"%])(\d+\.\d*(?:e-?\d+)?|\d+(?:e-?\d+)|\d+)(?![\w.\"]|\s*\])"
)
_STATEMENT: Final = re.compile(r"^\s+(?:[\w\[\]>.&*()-]+ (?:[+*|&^/-]|<<|>>)?= .*|\w+\(.*\));$")
_BLANKED: Final = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|^[ \t]*#[^\n]*', re.S | re.M)


@dataclass(frozen=True)
class Mutant:
    """A change to one place of a source."""

    file: str
    line: int
    start: int  #: in the text
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.old.strip()} -> {self.new.strip() or '(deleted)'}"

    def applied(self, text: str) -> str:
        """Return the source with the change."""
        return text[: self.start] + self.new + text[self.start + len(self.old) :]


@dataclass(frozen=True)
class Verdict:
    """The end of a mutant."""

    mutant: Mutant
    outcome: Literal["killed", "survived", "same", "not built"]
    by: str = ""  #: the check
    why: str = ""

    def values(self) -> JsonObject:
        """Return it as plain values."""
        one = self.mutant
        place = {"file": one.file, "line": one.line, "old": one.old, "new": one.new}
        return place | {"outcome": self.outcome, "by": self.by, "why": self.why}


def mutants_of(text: str, file: str) -> Iterator[Mutant]:
    """Yield the changes of a source in C: operators, constants, and statements left out."""
    plain = _BLANKED.sub(lambda hit: re.sub(r"[^\n]", " ", hit.group()), text)

    def at(start: int, old: str, new: str) -> Mutant:
        return Mutant(file, text.count("\n", 0, start) + 1, start, old, new)

    for pattern, others in _OPERATORS:
        for hit in pattern.finditer(plain):
            yield from (at(hit.start(), hit.group(), other) for other in others)
    for hit in _NUMBER.finditer(plain):
        yield at(hit.start(), hit.group(), _other_number(hit.group()))
    start = 0
    for line in plain.splitlines(keepends=True):
        statement = line.rstrip("\n")
        if _STATEMENT.match(statement):
            indent = len(statement) - len(statement.lstrip())
            yield at(start + indent, text[start + indent : start + len(statement)], ";")
        start += len(line)


def _other_number(number: str) -> str:
    if number.isdigit():
        return str(int(number) + 1)
    value = float(number)
    return repr(value * 1.1) if value else "1.0"


class Workshop(Closing):
    """A copy of a folder of sources, beside it, in which mutants are built.

    Parameters
    ----------
    folder : Path
        Sources; what they refer to outside, relative to it, is found from the copy, too.
    command : str
        Builds the program, in the folder.
    program : Path
        What it builds, in the folder.

    Raises
    ------
    RehearsalError
        If the sources as they are cannot be built.
    """

    def __init__(self, folder: Path, command: str, program: Path) -> None:
        folder, program = folder.resolve(), program.resolve()
        if not program.is_relative_to(folder):
            raise RehearsalError(f"{program} is not in {folder}: mutants are built in a copy of it")
        self._command = shlex.split(command)
        _remove_abandoned(folder)
        prefix = f"{_copies_of(folder)}{os.getpid()}-"
        self.copy = Path(tempfile.mkdtemp(prefix=prefix, dir=folder.parent))
        try:
            shutil.copytree(folder, self.copy, dirs_exist_ok=True, symlinks=True)
            self.program = self.copy / program.relative_to(folder)
            failure = self._build()
            if failure:
                raise RehearsalError(f"{command} does not build {folder}: {failure}")
            if not self.program.is_file():
                raise RehearsalError(f"{command} does not build {program.relative_to(folder)}")
            self._digest = self._digest_now()
            self._kills: dict[str, Counter[str]] = {}
        except BaseException:
            self.close()
            raise

    def sources(self) -> list[Path]:
        """Return the sources that are changed: all `.c` in the folder."""
        found = (path.relative_to(self.copy) for path in self.copy.rglob("*.c"))
        return sorted(path for path in found if not {"build", ".git"} & set(path.parts))

    def mutants(self) -> list[Mutant]:
        """Return all mutants of all sources."""
        return [
            mutant
            for path in self.sources()
            for mutant in mutants_of((self.copy / path).read_text(encoding="utf-8"), str(path))
        ]

    def judge(self, mutant: Mutant, checks: Sequence[Check]) -> Verdict:
        """Build a mutant and try the checks on it until one fails."""
        path = self.copy / mutant.file
        text = path.read_text(encoding="utf-8")
        path.write_text(mutant.applied(text), encoding="utf-8")
        try:
            failure = self._build()
            if failure:
                return Verdict(mutant, "not built", why=failure)
            if self._digest_now() == self._digest:
                return Verdict(mutant, "same", why="the compiler makes the same program of it")
            return self._tried(mutant, checks)
        finally:
            path.write_text(text, encoding="utf-8")

    def _tried(self, mutant: Mutant, checks: Sequence[Check]) -> Verdict:
        """Try first what has killed most mutants of the same source."""
        kills = self._kills.setdefault(mutant.file, Counter())
        order = sorted(checks, key=lambda check: -kills[check.name])
        for finding in conform(str(self.program), order):
            if finding.outcome == "failed":
                kills[finding.check.name] += 1
                return Verdict(mutant, "killed", finding.check.name, finding.line)
        return Verdict(mutant, "survived")

    def _build(self) -> str:
        """Return why it does not build; empty if it does."""
        try:
            done = subprocess.run(
                self._command,
                cwd=self.copy,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
                timeout=_BUILD_S,
                env={name: value for name, value in os.environ.items() if name != "MAKEFLAGS"},
            )
        except OSError as error:
            return f"{self._command[0]}: {error.strerror}"
        except subprocess.TimeoutExpired:
            return f"not within {_BUILD_S:g} s"
        said = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        if done.returncode == 0:
            return ""
        return next((line for line in said if "error" in line), said[0] if said else "no reason")

    def _digest_now(self) -> str:
        return hashlib.sha256(self.program.read_bytes()).hexdigest()

    def close(self) -> None:
        """Remove the copy."""
        shutil.rmtree(self.copy, ignore_errors=True)


def _copies_of(folder: Path) -> str:
    """Return how the names of a folder's copies begin; the process that made one follows."""
    return f".{folder.name}-mutants-"


def _remove_abandoned(folder: Path) -> None:
    """Remove the copies of processes that were killed before they could."""
    for copy in folder.parent.iterdir():
        process = copy.name.removeprefix(_copies_of(folder)).partition("-")[0]
        if copy.name != process and process.isdigit() and not Path("/proc", process).exists():
            shutil.rmtree(copy, ignore_errors=True)


def sample(mutants: Sequence[Mutant], most: int, seed: int) -> list[Mutant]:
    """Return at most so many mutants, drawn by a seed, in their order."""
    if len(mutants) <= most:
        return list(mutants)
    return [mutants[k] for k in sorted(random.Random(seed).sample(range(len(mutants)), most))]


def words_of(verdicts: Sequence[Verdict]) -> str:
    """Return the kill rate in words."""
    counts = dict.fromkeys(("killed", "survived", "same", "not built"), 0)
    for one in verdicts:
        counts[one.outcome] += 1
    tried = counts["killed"] + counts["survived"]
    rate = f"{counts['killed'] / tried:.1%}" if tried else "none"
    return (
        f"{counts['killed']} of {tried} mutants killed ({rate}), {counts['survived']} survived; "
        f"{counts['same']} were the same program, {counts['not built']} were not built"
    )
