"""The files of the page, read once: served from memory, never by a path that somebody sends."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Final

_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
FOLDER: Final = "page"


@dataclass(frozen=True)
class PageFile:
    """A file of the page.

    Attributes
    ----------
    content, packed : bytes
        As it is, and by gzip.
    """

    content: bytes
    packed: bytes
    kind: str  #: its media type


def page_files() -> dict[str, PageFile]:
    """Return all files that are served, by path from the root."""
    folder = resources.files(__package__).joinpath(FOLDER)
    found = {f"/{name}": file for name, file in _files_of(folder, "")}
    return {"/": found["/index.html"], **found}


def _files_of(folder: Traversable, before: str) -> list[tuple[str, PageFile]]:
    found = []
    for entry in sorted(folder.iterdir(), key=lambda one: one.name):
        if entry.is_dir():
            found += _files_of(entry, f"{before}{entry.name}/")
            continue
        kind = _TYPES.get("." + entry.name.rpartition(".")[2])
        if kind is not None:
            content = entry.read_bytes()
            packed = gzip.compress(content, 9, mtime=0)
            found.append((f"{before}{entry.name}", PageFile(content, packed, kind)))
    return found
