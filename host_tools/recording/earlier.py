"""The recording that is there when another one of its name begins: it is moved aside."""

from __future__ import annotations

from pathlib import Path

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import keep
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.note import path_beside, read_note


def keep_earlier(path: Path) -> Path | None:
    """Move a recording with its parts and its note into the folder `previous` beside it.

    What was there is replaced. Empty files, pipes and devices stay where they are.

    Parameters
    ----------
    path : Path
        Of the recording that is about to begin.

    Returns
    -------
    Path or None
        Where the earlier one is; None if there was none.

    Raises
    ------
    RecordError
        If it cannot be moved.
    """
    if not path.is_file() or not path.stat().st_size:
        return None
    try:
        return keep(path.parent, _files_of(path)) / path.name
    except RehearsalError as error:
        raise RecordError(f"recording {path}: {error}") from error


def put_back(path: Path, kept: Path) -> None:
    """Undo `keep_earlier`, for a recording that could not begin."""
    for name in _files_of(kept):
        (kept.parent / name).replace(path.parent / name)
    if not any(kept.parent.iterdir()):
        kept.parent.rmdir()


def _files_of(path: Path) -> list[str]:
    """Return the names of a recording's files that are there."""
    try:
        note = read_note(path)
    except RecordError:  # damaged: it is kept with the first part
        note = None
    parts = () if note is None else note.parts
    names = {path.name, path_beside(path).name, *(part.file for part in parts)}
    if note is not None and note.truth is not None:
        names.add(note.truth)
    return sorted(name for name in names if (path.parent / name).exists())
