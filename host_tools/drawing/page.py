"""Self-contained HTML pages: pictures inside and beside them, one style for all."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from rrins.host_tools.drawing.saving import png_of, write_pictures
from rrins.host_tools.files import keep, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT = "report.html"


class Image(NamedTuple):
    """A picture within a page."""

    source: str  #: the picture itself
    width: int  #: at 96 dots an inch


def _image(picture: Figure, png: bytes) -> Image:
    data = base64.b64encode(png).decode("ascii")
    return Image(f"data:image/png;base64,{data}", round(96 * picture.get_figwidth()))


def write_report(
    folder: Path,
    package: str,
    pictures: Mapping[str, Figure],
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
        Has the template ``report.html.j2``, which finds its pictures, for the macro of
        ``figure.html.j2``, in ``images`` and the program's name and version in ``version``.
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
    templates = environment(package)
    templates.filters.update(filters or {})
    pngs = {name: png_of(picture) for name, picture in pictures.items()}
    text = templates.get_template(f"{REPORT}.j2").render(
        images={name: _image(picture, pngs[name]) for name, picture in pictures.items()},
        version=f"rrins {metadata.version('rrins')}",
        **values,
    )
    page = folder / REPORT
    if keeps and page.exists() and page.read_bytes() != text.encode():
        keep(folder, keeps)
    write_text(page, text)
    return [page, *write_pictures(folder, pictures, pngs)]


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
