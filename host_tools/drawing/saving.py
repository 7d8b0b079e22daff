"""Pictures as files: PNG, SVG or PDF."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: Final = ("png", "svg", "pdf")
"""Formats of pictures, the default first."""

_format: ContextVar[str] = ContextVar("picture format", default=FORMATS[0])

_COLOURS = 40


@contextmanager
def pictures_as(form: str) -> Iterator[None]:
    """Write all pictures as one of `FORMATS` meanwhile."""
    before = _format.set(form)
    try:
        yield
    finally:
        _format.reset(before)


def names_of(*names: str) -> tuple[str, ...]:
    """Return the names of files that pictures without an ending may have."""
    return tuple(f"{name}.{form}" for name in names for form in FORMATS)


def write_pictures(
    folder: Path, pictures: Mapping[str, Figure], pngs: Mapping[str, bytes] | None = None
) -> list[Path]:
    """Write pictures, by name without an ending, into a folder; return their paths.

    `pngs` are those that are drawn already.

    Raises
    ------
    RehearsalError
        When one cannot be written.
    """
    paths = {name: folder / f"{name}.{_format.get()}" for name in pictures}
    for name, picture in pictures.items():
        png = (pngs or {}).get(name) if _format.get() == "png" else None
        write_picture(paths[name], picture, png)
    return list(paths.values())


def write_picture(path: Path, picture: Figure, data: bytes | None = None) -> None:
    """Write a picture, whole or not at all, in the format that the file's ending names.

    `data` is its content, if it is drawn already.

    Raises
    ------
    RehearsalError
        When it cannot be written, or the ending is none of `FORMATS`.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMATS:
        endings = ", ".join(f".{one}" for one in FORMATS)
        raise RehearsalError(f"{path}: cannot be written: ends in none of {endings}")
    if data is None:
        data = png_of(picture) if form == "png" else _drawn(picture, form)
    with replacing(path) as part:
        part.write_bytes(data)


def png_of(picture: Figure) -> bytes:
    """Return a picture as palette PNG: a third of the size with no visible difference."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    # `savefig` would draw twice, once for the layout alone, which `draw` makes as well.
    canvas = FigureCanvasAgg(picture)
    canvas.draw()  # type: ignore[no-untyped-call]  # of matplotlib
    size = canvas.get_width_height()
    drawn = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    image = Image.frombuffer("RGBA", size, drawn, "raw", "RGBA", 0, 1).convert("RGB")
    few = image.quantize(_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    packed = io.BytesIO()
    few.save(packed, format="png", dpi=(picture.dpi, picture.dpi))
    return packed.getvalue()


def _drawn(picture: Figure, form: str) -> bytes:
    """Return a picture as a file; the same picture gives the same bytes."""
    import matplotlib as mpl

    drawn = io.BytesIO()
    dated = {"svg": "Date", "pdf": "CreationDate"}[form]
    with mpl.rc_context({"svg.hashsalt": "rrins", "pdf.fonttype": 42}):
        picture.savefig(drawn, format=form, metadata={dated: None})
    return drawn.getvalue()
