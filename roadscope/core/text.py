"""Makes text from plug-ins and files safe to print."""

from __future__ import annotations

import unicodedata

MOST_CHARACTERS = 2000
"""Chosen by hand: a reason in a row of a board is read by people."""
UNPRINTABLE = frozenset({"Cc", "Cf", "Cs", "Co", "Cn"})
"""Unicode categories of control characters, of marks that reverse or hide text, of code points
without a character."""


def one_line(text: str, most: int = MOST_CHARACTERS) -> str:
    """Return a text as one line without control characters, shortened to `most` characters."""
    # Cut before it is searched: the text may be a gigabyte.
    words = " ".join(without_controls(text[: 4 * most]).split())
    return words if len(words) <= most and len(text) <= 4 * most else words[: most - 3] + "..."


def last_lines(text: str, most: int) -> str:
    """Return the last `most` characters of a text of several lines, without control characters."""
    lines = [without_controls(line) for line in text[-4 * most :].splitlines()]
    return "\n".join(lines)[-most:]


def error_text(error: BaseException) -> str:
    """Return an exception's type and text in one line, even if its own `__str__` fails."""
    try:
        name = str(type(error).__name__)
    except BaseException:
        name = "an exception without a name"
    try:
        text = str(error)
    except BaseException:
        text = "its text cannot be made"
    return one_line(f"{name}: {text[: 4 * MOST_CHARACTERS]}")


def without_controls(text: str) -> str:
    """Replace white space by blanks, and what cannot be printed by question marks."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        " " if letter.isspace() else "?" if unicodedata.category(letter) in UNPRINTABLE else letter
        for letter in text
    )
