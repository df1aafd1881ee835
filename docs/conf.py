"""Settings of Sphinx: `sphinx-build -W docs build/site` builds the site, without network."""

import os
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import roadscope  # noqa: E402

project = "roadscope"
author = "the roadscope authors"
project_copyright = f"2026, {author}"
release = version = roadscope.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "tables_of_code"]
exclude_patterns = ["_*.md"]
html_theme = "furo"
html_title = "roadscope"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False

# Tests run the notebooks; the build shows what they hold.
nb_execution_mode = "off"
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_ambiguous"]

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 88
add_module_names = False

FIELDS = re.compile(r"((?:\*{0,2}[A-Za-z_]\w*)(?:, \*{0,2}[A-Za-z_]\w*)*): +(?=\S)")
"""`name: text` or `name, name: text` at the beginning of a line: arguments, fields, results."""


def as_restructured_text(lines: list[str]) -> list[str]:
    """Return a docstring of ours, which is plain text with `names`, as reStructuredText.

    Lines `name: text` become a list of fields; a block that is indented after a blank line is code.
    """
    out: list[str] = []
    in_fields = in_code = False
    for k, line in enumerate(lines):
        before = lines[k - 1] if k else ""
        indented = line.startswith("    ")
        if in_code and (indented or not line.strip()):
            out.append(line)
            continue
        in_code = False
        if indented and not before.strip() and not in_fields:
            out += ["::", "", line]
            in_code = True
            continue
        field = FIELDS.match(line)
        if field and (in_fields or not before.strip()):
            in_fields = True
            if out and not out[-1].startswith((":", " ")) and out[-1]:
                out.append("")
            names = field[1].replace("*", r"\*")
            out.append(f":{names}: {inline(line[field.end() :])}")
            continue
        if not line.strip() or not indented:
            if in_fields and line.strip() and before.strip():
                out.append("")
            in_fields = False
        out.append(inline(line))
    return [*out, ""]


def inline(text: str) -> str:
    """Return a line with `code` as a literal and nothing else that means something to Sphinx."""
    parts = re.split(r"(`+[^`]+`+)", text)
    escaped = [re.sub(r"([*|\\])|(?<=\w)(_)(?!\w)", r"\\\1\2", part) for part in parts[::2]]
    code = [f"``{part.strip('`')}``" for part in parts[1::2]]
    return "".join(a + b for a, b in zip(escaped, [*code, ""], strict=True))


OUTSIDE = {
    "contributing": "CONTRIBUTING.md",
    "changelog": "CHANGELOG.md",
    "release": "RELEASE.md",
    "research": "research/README.md",
}
"""Pages whose text is a file outside of `docs`."""


def read_outside(app: object, page: str, content: list[str]) -> None:
    """Put the file into a page of `OUTSIDE`, with links that lead from there."""
    if page not in OUTSIDE:
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


def setup(app: object) -> None:
    """Let Sphinx read our docstrings."""

    def process(app: object, what: str, name: str, item: object, options: object, lines) -> None:
        lines[:] = as_restructured_text(lines)

    app.connect("autodoc-process-docstring", process)  # type: ignore[attr-defined]
    app.connect("source-read", read_outside)  # type: ignore[attr-defined]
