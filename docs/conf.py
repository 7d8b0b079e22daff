"""Sphinx: the pages of this folder and the API reference as a site that asks no other host.

The pages stay plain Markdown for whoever reads them in a checkout. What a site needs besides is
made here: the contents out of the tables of the index pages, the reference of a module where a page
of `api` lists it, the pages that stand at the top of the repository, and a zip of a folder that is
linked.
"""

from __future__ import annotations

import inspect
import logging
import os
import re
import shutil
import sys
import zipfile
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))
logging.disable(logging.DEBUG)  # to write what nobody sees takes a sixteenth of the time
os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled functions show their signatures and docstrings

project = "RRINS rehearsal"
release = metadata.version("rrins")
version = release
copyright = "2026 The RRINS rehearsal authors, MIT licence"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
exclude_patterns = ["_build"]

myst_heading_anchors = 4
highlight_language = "text"
copybutton_prompt_text = r">>> |\$ "
copybutton_prompt_is_regexp = True

default_role = "py:obj"  # single backticks of docstrings: code, and a link where it is known
python_maximum_signature_line_length = 88
add_module_names = False
toc_object_entries = False
autodoc_default_options = {
    "members": True,
    "show-inheritance": True,
    "special-members": "__call__",
    "ignore-module-all": True,  # what is passed on stands where it is defined
}
autodoc_member_order = "bysource"
autodoc_use_type_comments = False  # there are none, and to look for them takes a tenth of the time

napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["_static"]
html_css_files = ["rrins.css"]
html_copy_source = False
html_show_sourcelink = False
html_search_scorer = str(DOCS / "_static" / "search_scorer.js")
pygments_style = "friendly"
pygments_dark_style = "github-dark"

_LONGEST_VALUE = 100
_TRY = """
**<a href="try/index.html">Try it here</a>**: a rehearsal in your browser, with nothing to install.

"""
_BEFORE_TRY = "| you | begin with |"
_PAGE = DOCS.parent / "host_tools" / "dashboard" / "page"
_HEADING = re.compile(r"## +(?P<caption>.+)")
_ROW = re.compile(r"\| \[[^]]*\]\((?P<page>[^)#]+\.md)\)")
_MODULE = re.compile(r"^- `(?P<module>[\w.]+)`$", re.MULTILINE)
_OTHERS = re.compile(r"^- `(?P<package>[\w.]+)\.\*`\n", re.MULTILINE)
_REFERENCE = "\n## `{module}`\n\n```{{eval-rst}}\n.. automodule:: {module}\n```\n"
_OUTSIDE = {"contributing": "CONTRIBUTING.md", "changelog": "CHANGELOG.md"}
_TO_OUTSIDE = re.compile(r"\]\((?:\.\./)*(?P<name>CONTRIBUTING|CHANGELOG)\.md")
_FOLDER = re.compile(r"(?<=\]\()(?P<path>\.\./[^)#]+)(?=\))")


def _contents(text: str) -> str:
    """Return the tables of contents of an index page: for each section, its rows' pages."""
    sections: list[tuple[list[str], list[str]]] = [([], [])]
    for line in text.splitlines():
        if heading := _HEADING.fullmatch(line):
            sections.append(([f":caption: {heading['caption']}"], []))
        elif row := _ROW.match(line):
            sections[-1][1].append(row["page"])
    blocks = (
        "\n".join(["", "```{toctree}", ":hidden:", *caption, "", *pages, "```", ""])
        for caption, pages in sections
        if pages
    )
    return "".join(blocks)


def _zipped(app: Sphinx, page: Path, target: str) -> str:
    """Return what a link of a page shall lead to: a zip of the folder, if it is a folder."""
    folder = (page.parent / target).resolve()
    if not folder.is_dir():
        return target
    path = Path(app.doctreedir) / f"{folder.name}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.iterdir()):
            if file.is_file():
                archive.write(file, f"{folder.name}/{file.name}")
    return os.path.relpath(path, page.parent)


def _face() -> str:
    """Return the table of the names that the public face passes on."""
    import rrins

    rows = []
    for name in (name for name in getattr(rrins, "__all__", ()) if not name.startswith("_")):
        thing = getattr(rrins, name)
        module, own_name = getattr(thing, "__module__", ""), getattr(thing, "__qualname__", "")
        text = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ") if module else ""
        target = f"{{py:obj}}`{name} <{module}.{own_name}>`" if own_name else f"`{name}`"
        rows.append(f"| {target} | {text} |\n")
    return f"\n| name | |\n|---|---|\n{''.join(rows)}\n" if rows else ""


def _reference(listed: re.Match[str]) -> str:
    """Return the section on a module that a page lists."""
    names = _face() if listed["module"] == "rrins" else ""
    return _REFERENCE.format(module=listed["module"]) + names


def _others(package: str, text: str) -> str:
    """Return the list of a package's modules that a page does not name itself."""
    folder = DOCS.parent.joinpath(*package.split("."))
    own_modules = folder.glob("*.py") if package == "rrins" else folder.rglob("*.py")
    paths = (path.relative_to(folder).with_suffix("") for path in sorted(own_modules))
    names = [".".join((package, *path.parts)).removesuffix(".__init__") for path in paths]
    own = {*_MODULE.findall(text), package, f"{package}.__main__"}
    return "".join(f"- `{name}`\n" for name in names if name not in own)


def _outside(app: Sphinx, docname: str) -> str:
    """Return a page that stands at the top of the repository, its links as seen from `docs`."""
    path = DOCS.parent / _OUTSIDE[docname]
    app.env.note_dependency(str(path))
    return path.read_text(encoding="utf-8").replace("](docs/", "](")


def _read(app: Sphinx, docname: str, source: list[str]) -> None:
    """Give a page what the site needs of it besides its text."""
    page = Path(app.env.doc2path(docname))
    if page.suffix != ".md":
        return
    text = _outside(app, docname) if docname in _OUTSIDE else source[0]
    text = _TO_OUTSIDE.sub(lambda found: f"](/{found['name'].lower()}.md", text)
    text = _FOLDER.sub(lambda found: _zipped(app, page, found["path"]), text)
    if docname.startswith("api/"):
        text = _OTHERS.sub(lambda found: _others(found["package"], source[0]), text)
        text = _MODULE.sub(_reference, text)
    if docname == "index":  # only the site has that page
        text = text.replace(_BEFORE_TRY, _TRY + _BEFORE_TRY)
    if docname.startswith("api/"):  # found by the names that it defines, not by its words
        text = f"---\nnosearch: true\n---\n{text}"
    source[0] = text + (_contents(text) if page.name == "index.md" else "")


def _tidy(app: Sphinx, doctree: nodes.document) -> None:
    """Leave out values that fill a page; let types mean what their module calls so, no namesake."""
    for node in list(doctree.findall(addnodes.desc_annotation)):
        if len(node.astext()) > _LONGEST_VALUE and node.astext().lstrip().startswith("="):
            node.parent.remove(node)
    for node in doctree.findall(addnodes.pending_xref):
        if node.get("refdomain") == "py" and "refspecific" in node:
            del node["refspecific"]
            module = sys.modules.get(node.get("py:module") or "")
            meant = getattr(module, node["reftarget"], None)
            if isinstance(meant, type):
                node["reftarget"] = f"{meant.__module__}.{meant.__qualname__}"


def _is_noise(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what says nothing: the fields of a named tuple that have no text of their own."""
    return True if (getattr(obj, "__doc__", "") or "").startswith("Alias for field") else None


def _add_figures(app: Sphinx, pagename: str, *_: object) -> None:
    """Give the page of figures its scripts: the dashboard's own libraries, and precomputed runs."""
    if pagename == "what-for":
        app.add_css_file("dashboard/carried/uPlot.min.css")
        app.add_css_file("figures.css")
        for name in ("dashboard/carried/uPlot.iife.min.js", "figures_data.js", "figures.js"):
            app.add_js_file(name, loading_method="defer")


def _copy_dashboard(app: Sphinx, exception: Exception | None) -> None:
    """Copy what the figures use of the dashboard."""
    if exception is None and app.builder.format == "html":
        for pattern in ("scene.js", "parts.js", "carried/*"):
            for file in _PAGE.glob(pattern):
                to = Path(app.outdir) / "_static" / "dashboard" / file.relative_to(_PAGE)
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, to)


def setup(app: Sphinx) -> None:
    """Connect the above."""
    app.connect("html-page-context", _add_figures)
    app.connect("build-finished", _copy_dashboard)
    app.connect("source-read", _read)
    app.connect("doctree-read", _tidy)
    app.connect("autodoc-skip-member", _is_noise)
