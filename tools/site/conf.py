"""How ``make site`` builds the documents: Sphinx with MyST and the theme Furo, into ``build/site``.

Sphinx reads from the root of the repository, so that a link in a document is the same here and in a viewer of
the repository. What is a page is said by the lists in ``docs/index.md`` and ``docs/decisions/index.md``.
Whoever reads the site needs nothing from elsewhere: no fonts, no scripts, no search of somebody else.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from gateway import __version__

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "pitch-gateway"
version = release = __version__
root_doc = "docs/index"
extensions = ["myst_parser"]
include_patterns = [
    "docs/**",
    *(f"bench/{name}.md" for name in ("results", "attacks", "fleet", "screws")),
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "SECURITY.md",
]
exclude_patterns = [".*", "build", "dist"]
"""Folders in which there is much, and nothing to be found."""
nitpicky = True
highlight_language = "none"
"""Of code that does not say what it is."""
smartquotes = False
"""Or ``--option`` in a sentence gets a dash."""
myst_enable_extensions = ["tasklist"]
myst_heading_anchors = 4
"""Headings that a link may point to, named as viewers of repositories name them."""

html_theme = "furo"
html_title = f"pitch-gateway {__version__}"
html_favicon = "../../gateway/supervisor/page/icon.svg"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]

_LISTS = re.compile(r"^## (?P<caption>.+)$|^- \[[^]]+\]\((?P<page>[^)#]+)\.md\)", re.MULTILINE)


_FRONT = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url=docs/index.html">
<title>pitch-gateway</title>
<a href="docs/index.html">pitch-gateway</a>
</html>
"""
"""Leads from the root of the site to its first page."""


def add_toctrees(_: "Sphinx", docname: str, source: list[str]) -> None:
    """Make of each list of pages in an index the tree that Sphinx shows beside every page."""
    if Path(docname).name != "index":
        return
    trees: list[list[str]] = [[]]
    for found in _LISTS.finditer(source[0]):
        if found["caption"] is not None:
            trees.append([f":caption: {found['caption']}"])
        else:
            trees[-1].append(found["page"])
    source[0] += "".join(
        "\n\n```{toctree}\n:hidden:\n" + "\n".join(tree) + "\n```\n" for tree in trees if tree
    )


def add_front(app: "Sphinx", error: Exception | None) -> None:
    """Write the page at the root."""
    if error is None:
        Path(app.outdir, "index.html").write_text(_FRONT, encoding="utf-8")


def setup(app: "Sphinx") -> None:
    """Connect both."""
    app.connect("source-read", add_toctrees)
    app.connect("build-finished", add_front)
