"""Self-contained HTML pages: pictures inside, one style for all."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from PIL import Image

if TYPE_CHECKING:
    import matplotlib.figure

_COLOURS = 128


def png_of(picture: matplotlib.figure.Figure) -> bytes:
    """Return a picture as palette PNG: a third of the size with no visible difference."""
    drawn, packed = io.BytesIO(), io.BytesIO()
    picture.savefig(drawn, format="png", dpi=110)
    image = Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    image.save(packed, format="png", optimize=True)
    return packed.getvalue()


def base64_of(data: bytes) -> str:
    """Return a picture's bytes as they stand in a page."""
    return base64.b64encode(data).decode("ascii")


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
