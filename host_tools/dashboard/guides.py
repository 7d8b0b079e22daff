"""The guides of a clone's `docs/` as pages, for the links of the dashboard; none in a wheel."""

from __future__ import annotations

import html
import re
from functools import cache
from pathlib import Path
from typing import Final

from markdown_it import MarkdownIt
from markdown_it.token import Token

FOLDER: Final = Path(__file__).resolve().parents[2] / "docs"

_LINK: Final = re.compile(r"^([a-z-]+)\.md(#[a-z0-9-]+)?$")
_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title} – RRINS</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="../icon.svg"><link rel="stylesheet" href="../guide.css"></head>
<body>{body}</body></html>
"""


def guide_names() -> frozenset[str]:
    """Return the names of the guides that there are."""
    return frozenset(path.stem for path in FOLDER.glob("*.md"))


@cache
def guide(name: str) -> bytes:
    """Return a guide, one of `guide_names`, as a page."""
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = markdown.parse((FOLDER / f"{name}.md").read_text(encoding="utf-8"))
    title = name
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            words = tokens[place + 1].content
            title = words if token.tag == "h1" else title
            token.attrSet("id", slug(words))
        for child in token.children or []:
            _localize(child)
    body = markdown.renderer.render(tokens, markdown.options, {})
    return _PAGE.format(title=html.escape(title), body=body).encode()


def slug(words: str) -> str:
    """Return the name of a section in links, as GitHub and Sphinx make it."""
    return re.sub(r"[^\w -]", "", words.lower()).replace(" ", "-")


def _localize(token: Token) -> None:
    """Let a link to a guide lead to its page; pictures are described."""
    found = _LINK.match(str(token.attrGet("href") or ""))
    if token.type == "link_open" and found is not None:
        token.attrSet("href", found[1] + (found[2] or ""))
    if token.type == "image":
        token.type, token.tag = "text", ""
        token.content = f"[picture: {token.content}]"
