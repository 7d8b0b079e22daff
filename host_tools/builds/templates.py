"""Files of a build that are filled in."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined


def rendered(template: str, /, **values: object) -> str:
    """Return a template of this room with its values; those of XML are escaped."""
    templates = Environment(
        loader=PackageLoader(__package__, ""),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=lambda file: file is not None and ".xml" in file,
    )
    return templates.get_template(template).render(**values)
