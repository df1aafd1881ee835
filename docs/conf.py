"""Settings of Sphinx: `sphinx-build -W docs build/site` builds the site, without network."""

import os
import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

from tables_of_code import as_restructured_text, with_tables  # noqa: E402

import roadscope  # noqa: E402

project = "roadscope"
author = "the roadscope authors"
project_copyright = f"2026, {author}"
release = version = roadscope.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc"]
html_theme = "furo"
html_title = "roadscope"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False

# A build shows notebooks as they are stored, without outputs. The published site runs them, which
# takes minutes: `sphinx-build -D nb_execution_mode=force docs build/site`.
nb_execution_mode = "off"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 1200
nb_merge_streams = True
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 88
add_module_names = False

OUTSIDE = {
    "contributing": "CONTRIBUTING.md",
    "changelog": "CHANGELOG.md",
    "release": "RELEASE.md",
    "research": "research/README.md",
}
"""Pages whose text is a file outside of `docs`."""


PRINTED = re.compile(r"(?ms)^(?:With the [^\n]* prints\n\n)?```text\n.*?^```\n\n")
"""What a cell of a notebook printed, as its page tells it to those who do not run it."""


def read_page(app: Sphinx, page: str, content: list[str]) -> None:
    """Put tables of the code into a page; into one of `OUTSIDE` its file, with links from there."""
    if page.startswith("tutorials/") and app.config.nb_execution_mode != "off":
        content[0] = PRINTED.sub("", content[0])
    if page not in OUTSIDE:
        content[0] = with_tables(content[0])
        return
    file = ROOT / OUTSIDE[page]
    pages = {ROOT / path: f"{name}.md" for name, path in OUTSIDE.items()}
    pages[ROOT / "README.md"] = "index.md"

    def link(match: re.Match[str]) -> str:
        path, hash_sign, place = match[1].partition("#")
        if "://" in path or not path:
            return match[0]
        there = (file.parent / path).resolve()
        target = pages.get(there) or os.path.relpath(there, ROOT / "docs")
        return f"]({target}{hash_sign}{place})"

    content[0] = re.sub(r"\]\(([^)\s]+)\)", link, file.read_text("utf-8"))


def setup(app: Sphinx) -> None:
    """Let Sphinx read our docstrings."""

    def process(app: object, what: str, name: str, item: object, options: object, lines) -> None:
        lines[:] = as_restructured_text(lines)

    app.connect("autodoc-process-docstring", process)
    app.connect("source-read", read_page)
