"""Files that are there whole or not at all: what was there before is kept until then."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from rrins.host_tools.errors import RehearsalError

JsonObject = dict[str, Any]
"""A JSON object, for `--json` and for files; a table of a TOML file as well."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the path of a file that takes the place of `path` when it has been written.

    Raises
    ------
    RehearsalError
        When it cannot be written; what was at `path` before is there still.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise RehearsalError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, write: Callable[[IO[str]], None]) -> None:
    """Write a text file so that it is there whole or not at all.

    Raises
    ------
    RehearsalError
        When it cannot be written.
    """
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        write(file)
