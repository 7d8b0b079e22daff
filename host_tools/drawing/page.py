"""Self-contained HTML pages: pictures inside and beside them, one style for all."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from PIL import Image

from rrins.host_tools.files import keep, replacing, write_text

if TYPE_CHECKING:
    import matplotlib.figure

_COLOURS = 128
REPORT = "report.html"


def png_of(picture: matplotlib.figure.Figure) -> bytes:
    """Return a picture as palette PNG: a third of the size with no visible difference."""
    drawn, packed = io.BytesIO(), io.BytesIO()
    picture.savefig(drawn, format="png", dpi=110)
    image = Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    image.save(packed, format="png", optimize=True)
    return packed.getvalue()


def write_report(
    folder: Path,
    package: str,
    pictures: Mapping[str, matplotlib.figure.Figure],
    /,
    keeps: Sequence[str] = (),
    filters: Mapping[str, Callable[..., str]] | None = None,
    **values: Any,
) -> list[Path]:
    """Write `REPORT` and its pictures to a folder; return their paths, the report first.

    Parameters
    ----------
    folder : Path
    package : str
        Has the template ``report.html.j2``, which finds its pictures (base64) in ``images`` and the
        program's name and version in ``version``.
    pictures : mapping of str to Figure
        By file name without ending.
    keeps : sequence of str
        Files that are moved into the folder `previous` if there is a report of other content.
    filters : mapping of str to callable, optional
    **values
        Of the template.

    Raises
    ------
    RehearsalError
        When they cannot be written.
    """
    drawn = {name: png_of(picture) for name, picture in pictures.items()}
    templates = environment(package)
    templates.filters.update(filters or {})
    text = templates.get_template(f"{REPORT}.j2").render(
        images={name: base64.b64encode(data).decode("ascii") for name, data in drawn.items()},
        version=f"rrins {metadata.version('rrins')}",
        **values,
    )
    page = folder / REPORT
    if keeps and page.exists() and page.read_bytes() != text.encode():
        keep(folder, keeps)
    write_text(page, text)
    return [page, *(write_png(folder / f"{name}.png", data) for name, data in drawn.items())]


def write_png(path: Path, data: bytes) -> Path:
    """Write the bytes of `png_of` to a file, whole or not at all; return its path."""
    with replacing(path) as part:
        part.write_bytes(data)
    return path


def environment(package: str) -> Environment:
    """Return what renders the templates of a package.

    They may include ``style.css.j2``, which all pages share.
    """
    return Environment(
        loader=ChoiceLoader(
            [PackageLoader(package, "."), PackageLoader("rrins.host_tools.drawing", ".")]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
