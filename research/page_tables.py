"""Tables of Markdown pages that are made anew below comments which say what stands in them."""

import re
from collections.abc import Callable, Iterable, Sequence


def with_tables(
    page: str, mark: re.Pattern[str], table: Callable[[re.Match[str]], list[str] | None]
) -> str:
    """Return a page with its tables made anew.

    mark: of a comment above a table. table: returns its lines, or None if it stays as it is.
    """
    lines, out = page.split("\n"), []
    while lines:
        out.append(lines.pop(0))
        comment = mark.fullmatch(out[-1])
        made = table(comment) if comment else None
        if made is None:
            continue
        while lines and (not lines[0] or lines[0].startswith("|")):
            lines.pop(0)
        out += ["", *made, ""]
    return "\n".join(out)


def markdown_table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    rows = [heads, ["---"] * len(heads), *lines]
    return ["| " + " | ".join(cells).lstrip() + " |" for cells in rows]
